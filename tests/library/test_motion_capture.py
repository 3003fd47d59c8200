"""Motion-capture files, written here as their makers write them: right, a gap stays a gap, and damage is told."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from library.errors import ChoiceNeeded, ReaderError
from library.readers import Choices, read, ros_bag
from tests.library.capture_files import (
    FORMATS,
    RATE,
    TIMES,
    WAYS,
    c3d_by_the_standard,
    c3d_file,
    motive,
    rosbag_folder,
    trc,
    vicon,
)


@pytest.mark.parametrize("name", FORMATS)
def test_the_chosen_marker_is_read_with_its_gap_and_exact_times(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(FORMATS[name](), encoding="utf-8")
    (way,) = read(path, Choices(marker="Tool", up_axis="z"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, rtol=1e-14)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-12)
    assert np.isnan(way.points[10:13]).all()
    assert way.source == name
    (wrist,) = read(path, Choices(marker="wrist", up_axis="z"))
    np.testing.assert_allclose(wrist.points, WAYS[0] * 0.001, rtol=1e-14)


@pytest.mark.parametrize("name", FORMATS)
def test_which_marker_has_to_be_said_where_there_are_several(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(FORMATS[name](), encoding="utf-8")
    with pytest.raises(ChoiceNeeded, match=r"2 markers; choose one of .*Wrist, .*Tool") as question:
        read(path, Choices(up_axis="z"))
    assert question.value.choice == "marker"
    for answer in question.value.options:
        assert len(read(path, Choices(marker=answer, up_axis="z"))) == 1
    with pytest.raises(ReaderError, match="no marker 'Elbow'"):
        read(path, Choices(marker="Elbow", up_axis="z"))


@pytest.mark.parametrize("name", ["tabs.trc", "motive.csv"])
def test_which_axis_points_up_has_to_be_said_where_the_format_does_not(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(FORMATS[name](), encoding="utf-8")
    with pytest.raises(ChoiceNeeded, match="choose the up axis") as question:
        read(path, Choices(marker="Tool"))
    assert (question.value.choice, question.value.options) == ("up_axis", ("x", "y", "z"))


@pytest.mark.parametrize("up_axis", ["x", "y", "z"])
def test_turning_puts_the_chosen_axis_up_and_mirrors_nothing(tmp_path: Path, up_axis: Any) -> None:
    path = tmp_path / "vicon.csv"
    path.write_text(vicon())
    (way,) = read(path, Choices(marker="Wrist", up_axis=up_axis))
    points = WAYS[0] * 0.001
    np.testing.assert_allclose(way.points[:, 2], points[:, "xyz".index(up_axis)])
    turn, *_ = np.linalg.lstsq(points, way.points, rcond=None)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1.0)


BROKEN = [
    ("vicon.csv", "Trajectories\n120", "Trajectories\n0", "no frame rate"),
    ("vicon.csv", "mm,mm,mm", "furlong,mm,mm", "unit"),
    ("vicon.csv", "Sub Frame,X", "Subframe,X", "Frame, Sub Frame"),
    ("vicon.csv", "\n60,0,", "\n60,0,#", "not a number"),
    ("vicon.csv", "\n61,", "\n60,", "does not come after"),
    ("tabs.trc", "120\t120\t652", "60\t60\t652", "does not fit its frame number"),
    ("tabs.trc", "\tmm\t", "\tyards\t", "'yards'"),
    ("tabs.trc", "Frame#", "Frames", "Frame#, Time"),
    ("tabs.trc", "Z2", "Q2", "no columns X2, Y2, Z2"),
    ("tabs.trc", "PathFileType", "Path", "PathFileType"),
    ("motive.csv", "Millimeters", "Parsecs", "'Parsecs'"),
    ("motive.csv", "Export Frame Rate,120", "Export Frame Rate,60", "does not fit its frame number"),
    ("motive.csv", "Frame,Time", "Rahmen,Time", "no line that begins with Frame"),
    ("motive.csv", ",Tool,Tool,Tool", ",Tool,Tool,Wrist", "different bodies"),
    ("motive.csv", "\n20,", "\n19.5,", "does not come after|fit"),
]


@pytest.mark.parametrize(("name", "old", "new", "words"), BROKEN)
def test_a_mended_or_broken_file_is_told(tmp_path: Path, name: str, old: str, new: str, words: str) -> None:
    text = FORMATS[name]()
    assert old in text
    path = tmp_path / name
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ReaderError, match=words):
        read(path, Choices(marker="Wrist" if name == "vicon.csv" else "Tool", up_axis="z"))


def trc_of_old() -> str:
    """Return a TRC as older Motion Analysis exports are: spaces after PathFileType, values two tabs apart."""
    lines = trc().splitlines()
    lines[0] = "PathFileType  4\t(X/Y/Z) C:\\takes\\anna"
    lines[2] = "\t\t".join(f"  {cell}" for cell in lines[2].split("\t"))
    return "\n".join([*lines[:6], *(f"{line}\t" for line in lines[6:])]) + "\n"


def trc_cut_out() -> str:
    """Return a TRC of a part of a take: frames and times begin where the part did."""
    lines = trc().splitlines()
    rows = [line.split("\t") for line in lines[6:]]
    moved = [[str(int(row[0]) + 184), f"{float(row[1]) + 184 / RATE:.3f}", *row[2:]] for row in rows]
    return "\n".join([*lines[:6], *("\t".join(row) for row in moved)]) + "\n"


def motive_of_old() -> str:
    """Return a Motive 1.x export: no labels before types and names, no export rate, the time column called Time."""
    lines = motive().replace(",Export Frame Rate,120.000000", "").replace("240.000000", "120.000000").splitlines()
    for number, label in ((2, ",Type,"), (3, ",Name,"), (4, ",ID,")):
        lines[number] = lines[number].replace(label, ",,", 1)
    lines[6] = lines[6].replace("Time (Seconds)", "Time")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("name", "make"),
    [("old.trc", trc_of_old), ("part.trc", trc_cut_out), ("old.csv", motive_of_old)],
)
def test_exports_of_other_years_are_read_alike(tmp_path: Path, name: str, make: Callable[[], str]) -> None:
    path = tmp_path / name
    path.write_text(make(), encoding="utf-8")
    (way,) = read(path, Choices(marker="Tool", up_axis="z"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, rtol=1e-14)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-12)


def test_a_solved_and_a_measured_marker_of_one_name_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "motive.csv"
    text = motive().replace(",Wrist" * 8, ",Tool" * 8)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ChoiceNeeded, match=r"Tool \(Rigid Body\), Tool \(Marker\)"):
        read(path, Choices(up_axis="z"))
    (way,) = read(path, Choices(marker="Tool (Marker)", up_axis="z"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, rtol=1e-14)


def test_c3d_gives_unit_rate_and_gaps(tmp_path: Path) -> None:
    path = c3d_file(tmp_path / "stroke.c3d")
    (way,) = read(path, Choices(marker="Tool"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, atol=1e-7)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-12)
    assert np.isnan(way.points[10:13]).all()
    whole = path.read_bytes()
    for cut in (0, 1, 100, 512, 1100, len(whole) // 2, len(whole) - 600):
        path.write_bytes(whole[:cut])
        with pytest.raises(ReaderError):
            read(path, Choices(marker="Tool"))


@pytest.mark.parametrize(("scale", "exact"), [(0.05, 0.025e-3), (-0.05, 1e-8)], ids=["integers", "floats"])
def test_a_c3d_made_by_the_standard_alone_is_read(tmp_path: Path, scale: float, exact: float) -> None:
    path = c3d_by_the_standard(tmp_path / "standard.c3d", scale=scale)
    for marker, name in enumerate(("Wrist", "Tool")):
        (way,) = read(path, Choices(marker=name))
        np.testing.assert_allclose(way.points, WAYS[marker] * 0.001, atol=exact + 1e-9)
        np.testing.assert_allclose(way.times, TIMES, atol=1e-12)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_ros_bag_gives_the_poses_of_a_topic(tmp_path: Path, storage: str) -> None:
    folder = rosbag_folder(tmp_path / "recording", storage)
    (way,) = read(folder, Choices(topic="/tool"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, rtol=1e-14)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-8)
    with pytest.raises(ReaderError, match="choose one of /tool, /wrist"):
        read(folder)
    (data,) = [file for file in folder.iterdir() if file.suffix in {".db3", ".mcap"}]
    (again,) = read(data, Choices(topic="/tool"))
    assert again.points.tobytes() == way.points.tobytes()
    whole = data.read_bytes()
    data.write_bytes(whole[: len(whole) // 2])
    try:
        (part,) = read(folder, Choices(topic="/tool"))
    except ReaderError:
        return
    assert part.points.tobytes() == way.points[: len(part.points)].tobytes()


@pytest.mark.parametrize(("name", "module"), [("a.bag", ros_bag)])
def test_a_missing_extra_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, module: Any) -> None:
    path = tmp_path / name
    path.write_bytes(b"x" * 2000)
    monkeypatch.setattr(module, "find_spec", lambda package: None)
    with pytest.raises(ReaderError, match=r"install opcua-skill\[formats\]"):
        read(path)

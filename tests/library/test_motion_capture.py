"""Motion-capture files, written here as their makers write them: right, a gap stays a gap, and damage is told."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from library.errors import ChoiceNeeded, ReaderError
from library.readers import Choices, c3d, read, ros_bag

FRAMES = 40
RATE = 120.0
TIMES = np.arange(FRAMES) / RATE
# Two markers in mm; the second is lost for three frames.
WAYS = np.round(
    np.stack([np.column_stack([np.sin(TIMES) * 100 + k, np.cos(TIMES) * 50, TIMES * 30]) for k in (0, 7)]), 4
)
WAYS[1, 10:13] = np.nan


def cells(values: Any) -> list[str]:
    return ["" if np.isnan(value) else f"{value:.4f}" for value in np.ravel(values)]


def vicon() -> str:
    head = [
        "Trajectories",
        f"{RATE:g}",
        ",,Anna:Wrist,,,Anna:Tool,,",
        "Frame,Sub Frame,X,Y,Z,X,Y,Z",
        ",,mm,mm,mm,mm,mm,mm",
    ]
    rows = [",".join([str(i + 51), "0", *cells(WAYS[:, i])]) for i in range(FRAMES)]
    before = ["Devices", "1200", ",,Force", "Frame,Sub Frame,Fx", ",,N", "51,0,1.5", ""]
    return "\n".join([*before, *head, *rows, ""]) + "\n"


def trc(mark: str = "\t") -> str:
    head = [
        ["PathFileType", "4", "(X/Y/Z)", "anna.trc"],
        [
            "DataRate",
            "CameraRate",
            "NumFrames",
            "NumMarkers",
            "Units",
            "OrigDataRate",
            "OrigDataStartFrame",
            "OrigNumFrames",
        ],
        [f"{RATE:g}", f"{RATE:g}", "652", "2", "mm", f"{RATE:g}", "1", "652"],
        ["Frame#", "Time", "Wrist", "", "", "Tool", "", ""],
        ["", "", "X1", "Y1", "Z1", "X2", "Y2", "Z2"],
        [""],
    ]
    rows = [[str(i + 1), f"{TIMES[i]:.3f}", *cells(WAYS[:, i])] for i in range(FRAMES)]
    return "\n".join(mark.join(row) for row in [*head, *rows]) + "\n"


def motive() -> str:
    first = "Format Version,1.23,Take Name,take 下午,Capture Frame Rate,240.000000,Export Frame Rate,120.000000"
    first += ",Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global"
    head = [
        first,
        "",
        ",Type" + ",Rigid Body" * 8 + ",Marker" * 3,
        ",Name" + ",Wrist" * 8 + ",Tool" * 3,
        ",ID" + ',"A1"' * 8 + ',"B2"' * 3,
        ",," + ",".join(["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3),
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z",
    ]
    rows = [
        ",".join([str(i), f"{TIMES[i]:.3f}", "0", "0", "0", "1", *cells(WAYS[0, i]), "0.1", *cells(WAYS[1, i])])
        for i in range(FRAMES)
    ]
    return "\n".join([*head, *rows]) + "\n"


FORMATS: dict[str, tuple[Callable[[], str], str]] = {
    "vicon.csv": (vicon, "Anna:Tool"),
    "tabs.trc": (trc, "Tool"),
    "commas.trc": (lambda: trc(","), "Tool"),
    "motive.csv": (motive, "Tool"),
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_chosen_marker_is_read_with_its_gap_and_exact_times(tmp_path: Path, name: str) -> None:
    make, marker = FORMATS[name]
    path = tmp_path / name
    path.write_text(make(), encoding="utf-8")
    (way,) = read(path, Choices(marker=marker, up_axis="z"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, rtol=1e-14)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-12)
    assert np.isnan(way.points[10:13]).all()
    assert way.source == name
    (wrist,) = read(path, Choices(marker="wrist", up_axis="z"))
    np.testing.assert_allclose(wrist.points, WAYS[0] * 0.001, rtol=1e-14)


@pytest.mark.parametrize("name", FORMATS)
def test_which_marker_has_to_be_said_where_there_are_several(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_text(FORMATS[name][0](), encoding="utf-8")
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
    path.write_text(FORMATS[name][0](), encoding="utf-8")
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
    text = FORMATS[name][0]()
    assert old in text
    path = tmp_path / name
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ReaderError, match=words):
        read(path, Choices(marker="Wrist" if name == "vicon.csv" else "Tool", up_axis="z"))


@given(
    name=st.sampled_from(sorted(FORMATS)),
    where=st.integers(0, 10**6),
    kind=st.sampled_from(["cut", "drop", "repeat", "swap", "cell"]),
)
@settings(deadline=None, max_examples=200)
def test_a_damaged_file_is_an_error_or_a_part_of_the_truth(
    tmp_path_factory: pytest.TempPathFactory, name: str, where: int, kind: str
) -> None:
    make, marker = FORMATS[name]
    text = make()
    lines = text.splitlines(keepends=True)
    at = where % len(lines)
    if kind == "cut":
        text = text[: where % len(text)]
    else:
        if kind == "drop":
            lines.pop(at)
        elif kind == "repeat":
            lines.insert(at, lines[at])
        elif kind == "swap":
            lines[at], lines[at - 1] = lines[at - 1], lines[at]
        else:
            mark = "\t" if name == "tabs.trc" else ","
            parts = lines[at].split(mark)
            parts.pop(where % len(parts))
            lines[at] = mark.join(parts) + ("" if parts and parts[-1].endswith("\n") else "\n")
        text = "".join(lines)
    path = tmp_path_factory.getbasetemp() / name
    path.write_text(text, encoding="utf-8")
    try:
        (found,) = read(path, Choices(marker=marker, up_axis="z"))
    except ReaderError as refusal:
        assert str(refusal).startswith(str(path))
        return
    truth = {tuple(np.nan_to_num(point, nan=9.0)): time for point, time in zip(WAYS[1] * 0.001, TIMES, strict=True)}
    seen = [(tuple(np.nan_to_num(point, nan=9.0)), time) for point, time in zip(found.points, found.times, strict=True)]
    for point, _ in seen[:-1]:
        assert any(np.allclose(point, true, rtol=0, atol=1e-9) for true in truth)
    step = np.diff(found.times) * RATE
    np.testing.assert_allclose(step, np.round(step), atol=1e-6)


def test_c3d_gives_unit_rate_and_gaps(tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["Wrist", "Tool"]
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    points = np.ones((4, 2, FRAMES))
    points[:3] = WAYS.transpose(2, 0, 1)
    content["data"]["points"] = points
    path = tmp_path / "stroke.c3d"
    content.write(str(path))
    (way,) = read(path, Choices(marker="Tool"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, atol=1e-7)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-12)
    assert np.isnan(way.points[10:13]).all()
    whole = path.read_bytes()
    for cut in (0, 1, 100, 512, 1100, len(whole) // 2, len(whole) - 600):
        path.write_bytes(whole[:cut])
        with pytest.raises(ReaderError):
            read(path, Choices(marker="Tool"))


def test_a_parser_that_crashes_takes_nobody_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "stroke.c3d"
    path.write_bytes(b"x")
    monkeypatch.setattr(c3d.sys, "executable", str(tmp_path / "crash"))
    (tmp_path / "crash").write_text("#!/bin/sh\nkill -SEGV $$\n")
    (tmp_path / "crash").chmod(0o700)
    with pytest.raises(ReaderError, match="the parser crashed"):
        c3d._parsed_apart(path)


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_ros_bag_gives_the_poses_of_a_topic(tmp_path: Path, storage: str) -> None:
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    folder = tmp_path / "recording"
    kinds = {
        name: store.types[name] for name in store.types if name.startswith(("geometry_msgs", "std_msgs", "builtin"))
    }
    pose, header = kinds["geometry_msgs/msg/PoseStamped"], kinds["std_msgs/msg/Header"]
    with rosbag2.Writer(folder, version=8, storage_plugin=getattr(rosbag2.StoragePlugin, storage)) as writer:
        for topic in ("/tool", "/wrist"):
            connection = writer.add_connection(topic, pose.__msgtype__, typestore=store)
            for i in range(FRAMES):
                nanoseconds = 1_700_000_000_000_000_000 + round(TIMES[i] * 1e9)
                x, y, z = np.nan_to_num(WAYS[1, i] * 0.001, nan=np.nan).tolist()
                message = pose(
                    header=header(
                        stamp=kinds["builtin_interfaces/msg/Time"](
                            sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9
                        ),
                        frame_id="plate",
                    ),
                    pose=kinds["geometry_msgs/msg/Pose"](
                        position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=z),
                        orientation=kinds["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
                    ),
                )
                writer.write(connection, nanoseconds, store.serialize_cdr(message, pose.__msgtype__))
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


@pytest.mark.parametrize(("name", "module"), [("a.c3d", c3d), ("a.bag", ros_bag)])
def test_a_missing_extra_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, module: Any) -> None:
    path = tmp_path / name
    path.write_bytes(b"x" * 2000)
    monkeypatch.setattr(module, "find_spec", lambda package: None)
    with pytest.raises(ReaderError, match=r"install opcua-skill\[formats\]"):
        read(path)

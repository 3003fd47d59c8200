"""Files after what happens to files: an error that names the file, or the samples that really stand in it."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from library.errors import ReaderError
from library.readers import Choices, read
from library.readers import read_upload as read_upload_apart
from library.readers.plain_csv import write_all
from models.demonstration import Demonstration
from tests.library.capture_files import FORMATS, RATE, TIMES, WAYS, c3d_file, rosbag_folder


def read_upload(name: str, content: bytes, choices: Choices | None = None) -> list[Demonstration]:
    """Read as an upload is read, in this process: a thousand damaged files need no thousand processes."""
    return read_upload_apart(name, content, choices, read)


CHOSEN = Choices(marker="Tool", up_axis="z")
TEXT_DAMAGES = (
    "cut",
    "drop",
    "repeat",
    "swap lines",
    "drop a cell",
    "swap columns",
    "nan",
    "byte",
    "empty",
    "other marks",
)


def damaged(text: str, kind: str, where: int, other: int) -> bytes:
    """Return the text of a file after one kind of damage."""
    lines = text.splitlines(keepends=True)
    at, to = where % len(lines), other % len(lines)
    mark = "\t" if "\t" in text else ","
    if kind == "cut":
        return text.encode()[: where % len(text)]
    if kind == "byte":
        content = bytearray(text.encode())
        content[where % len(content)] = 0x80 | other % 128
        return bytes(content)
    if kind == "other marks":
        return text.replace(mark, ";").encode()
    if kind == "drop":
        lines.pop(at)
    elif kind == "repeat":
        lines.insert(to, lines[at])
    elif kind == "swap lines":
        lines[at], lines[to] = lines[to], lines[at]
    else:
        cells = lines[at].rstrip("\n").split(mark)
        one, two = other % len(cells), (other // 7) % len(cells)
        if kind == "drop a cell":
            cells.pop(one)
        elif kind == "swap columns":
            # Names that change places name the other marker: that is another file, and not a damaged one.
            if "Tool" not in lines[at]:
                cells[one], cells[two] = cells[two], cells[one]
        else:
            cells[one] = "nan" if kind == "nan" else ""
        lines[at] = mark.join(cells) + "\n"
    return "".join(lines).encode()


def only_true_samples(found: Demonstration, *, but: int = 1) -> bool:
    """Return whether every sample of the marker is a true one at its true time, ``but`` the last and one at most.

    One may be in a wrong place or at a wrong time: where a format keeps no sums, nobody can tell that a bit of it is
    another.
    """
    grid = found.times * RATE
    if (np.diff(grid) <= 0).any():
        return False
    grid -= np.median(grid - np.round(grid))
    frames = np.round(grid).astype(int)
    astray = np.abs(grid - frames) > 1e-3
    truth = WAYS[1] * 0.001
    for start in range(-int(frames[-1]), len(truth)):
        places = frames + start
        there = (places >= 0) & (places < len(truth))
        told = truth[np.where(there, places, 0)]
        same = np.isclose(found.points, told, rtol=0, atol=1e-6, equal_nan=True).all(axis=1)
        if int((astray | ~there | ~same).sum()) <= but:
            return True
    return False


@given(
    name=st.sampled_from(sorted(FORMATS)),
    kind=st.sampled_from(TEXT_DAMAGES),
    where=st.integers(0, 10**6),
    other=st.integers(0, 10**6),
)
@settings(deadline=None, max_examples=400)
def test_a_damaged_text_file_is_an_error_or_true_samples(name: str, kind: str, where: int, other: int) -> None:
    text = FORMATS[name]()
    content = damaged(text, kind, where, other)
    try:
        (found,) = read_upload(name, content, CHOSEN)
    except ReaderError as refusal:
        assert str(refusal).startswith(name)
        assert "; " in str(refusal)
        return
    # A sample can be lost (a cell that became empty or nan), and a number can lose digits where a file was cut.
    lost = np.isnan(found.points).all(axis=1) & ~np.isnan(WAYS[1][: len(found.points)]).all(axis=1)
    assert only_true_samples(found, but=max(1, int(lost.sum()))), f"{kind} made a wrong trajectory of {name}"


@given(
    columns=st.permutations(["t_s", "x_m", "y_m", "z_m", "trigger"]),
    where=st.integers(0, 10**6),
    kind=st.sampled_from(["nan", "half", "text", "time"]),
)
@settings(deadline=None, max_examples=100)
def test_plain_csv_goes_by_the_names_of_its_columns(columns: list[str], where: int, kind: str) -> None:
    values = {
        "t_s": [repr(float(t)) for t in TIMES],
        "trigger": ["1"] * len(TIMES),
        **{f"{axis}_m": [repr(float(v)) for v in WAYS[0][:, i] * 0.001] for i, axis in enumerate("xyz")},
    }
    row = where % len(TIMES)
    if kind == "nan":
        for axis in "xyz":
            values[f"{axis}_m"][row] = "NaN"
    else:
        values["t_s" if kind == "time" else "y_m"][row] = {"half": "", "text": "--", "time": "1e9"}[kind]
    lines = [",".join(columns), *(",".join(values[name][i] for name in columns) for i in range(len(TIMES)))]
    try:
        (found,) = read_upload("stroke.csv", "\n".join(lines).encode())
    except ReaderError as refusal:
        assert kind != "nan"
        assert re.match(rf"stroke.csv, line ({row + 2}|{row + 3}): ", str(refusal))
        return
    assert kind == "nan" or (kind == "time" and row == len(TIMES) - 1)
    truth = WAYS[0] * 0.001
    truth[row] = np.nan if kind == "nan" else truth[row]
    np.testing.assert_array_equal(found.points, truth)


@pytest.fixture(scope="module")
def whole_c3d(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    return c3d_file(tmp_path_factory.mktemp("c3d") / "whole.c3d").read_bytes()


@pytest.mark.slow
@given(spot=st.one_of(st.integers(0, 1600), st.integers(0, 10**6)), flip=st.integers(1, 255), cut=st.booleans())
@settings(deadline=None, max_examples=12)
def test_a_damaged_c3d_is_an_error_or_true_samples(whole_c3d: bytes, spot: int, flip: int, cut: bool) -> None:
    spot %= len(whole_c3d)
    content = whole_c3d[:spot] if cut else whole_c3d[:spot] + bytes([whole_c3d[spot] ^ flip]) + whole_c3d[spot + 1 :]
    assert_error_or_true("stroke.c3d", content)


def assert_error_or_true(name: str, content: bytes) -> None:
    try:
        (found,) = read_upload(name, content, Choices(marker="Tool", topic="/tool"))
    except ReaderError as refusal:
        assert str(refusal).startswith(name)
        return
    assert only_true_samples(found)


@pytest.mark.parametrize(
    ("spot", "value", "words"),
    [
        (20, b"\x00\x00\x70\x42", "different frame rates, 60 and 120"),
        (12, b"\x00\x00\x20\xc2", "different scales, -40 and"),
        (2, b"\xff\x7f", "it may be cut off"),
        (0, b"\x00", "does not begin as a C3D file"),
    ],
)
def test_what_a_c3d_says_twice_has_to_agree(whole_c3d: bytes, spot: int, value: bytes, words: str) -> None:
    with pytest.raises(ReaderError, match=words):
        read_upload("stroke.c3d", whole_c3d[:spot] + value + whole_c3d[spot + len(value) :], Choices(marker="Tool"))


@pytest.fixture(scope="module", params=["SQLITE3", "MCAP"])
def whole_bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = rosbag_folder(tmp_path_factory.mktemp("bag") / "recording", request.param)
    [file] = [one for one in folder.iterdir() if one.suffix in {".db3", ".mcap"}]
    return file


def test_a_file_of_a_bag_alone_is_read_without_its_folder(whole_bag: Path) -> None:
    (found,) = read_upload(whole_bag.name, whole_bag.read_bytes(), Choices(topic="/tool"))
    np.testing.assert_allclose(found.points, WAYS[1] * 0.001, rtol=1e-14)
    assert (found.demonstration_id, found.source) == (whole_bag.stem, whole_bag.name)


@given(spot=st.integers(0, 10**7), flip=st.integers(1, 255), cut=st.booleans())
@example(spot=32593, flip=64, cut=False)  # a time that is 16 microseconds another
@settings(deadline=None, max_examples=40)
def test_a_damaged_bag_is_an_error_or_true_samples(whole_bag: Path, spot: int, flip: int, cut: bool) -> None:
    content = whole_bag.read_bytes()
    spot %= len(content)
    damaged_ = content[:spot] if cut else content[:spot] + bytes([content[spot] ^ flip]) + content[spot + 1 :]
    assert_error_or_true(whole_bag.name, damaged_)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("../../etc/stroke.csv", "stroke.csv"),
        ("C:\\takes\\stroke one.csv", "stroke one.csv"),
        ("...", "..."),
        ("ström.csv", "ström.csv"),
        ("", "upload"),
    ],
)
def test_an_upload_is_named_as_its_owner_named_it(name: str, shown: str) -> None:
    with pytest.raises(ReaderError) as refusal:
        read_upload(name, b"")
    assert str(refusal.value).startswith(f"{shown}: ")


def test_several_demonstrations_are_written_into_one_file_and_read_again(tmp_path: Path) -> None:
    turned = np.tile([0.0, 0.0, 0.6, 0.8], (len(TIMES), 1))
    given_: dict[str, Any] = {"triggers": TIMES < 0.2, "orientations": turned}
    shown = [Demonstration(name, TIMES, way * 0.001, **given_) for name, way in zip("ab", WAYS, strict=True)]
    write_all(tmp_path / "both.csv", shown)
    for before, after in zip(shown, read(tmp_path / "both.csv"), strict=True):
        assert after.points.tobytes() == before.points.tobytes()
        assert after.times.tobytes() == before.times.tobytes()
        assert np.array_equal(after.triggers, before.triggers)
        assert after.orientations is not None
        np.testing.assert_allclose(after.orientations, turned, rtol=1e-15)

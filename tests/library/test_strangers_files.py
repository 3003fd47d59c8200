"""Files as other programs and other countries write them: what stands in them, or a refusal that helps."""

import bz2
import io
import os
import struct
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from library.errors import ReaderError
from library.readers import Choices, Reader, isolation, read, read_apart, read_upload
from tests.library.capture_files import FRAMES, RATE, TIMES, WAYS, cells, trc

Make = Callable[..., Path]


@pytest.fixture
def file(tmp_path: Path) -> Make:
    def make(content: str | bytes, name: str = "stroke.csv") -> Path:
        (tmp_path / name).write_bytes(content.encode() if isinstance(content, str) else content)
        return tmp_path / name

    return make


def qualisys(*, before: int = 2, heads: bool = True) -> str:
    keys = [f"NO_OF_FRAMES\t{FRAMES}", "NO_OF_CAMERAS\t8", "NO_OF_MARKERS\t2", f"FREQUENCY\t{RATE:g}"]
    keys += ["NO_OF_ANALOG\t0", "ANALOG_FREQUENCY\t0", "DESCRIPTION\t--", "TIME_STAMP\t2026-11-30, 10:00:00.000\t8.1"]
    keys += ["DATA_INCLUDED\t3D", "MARKER_NAMES\tWrist\tTool", "TRAJECTORY_TYPES\tMeasured\tMixed"]
    axes = [f"{name} {axis}" for name in ("Wrist", "Tool") for axis in "XYZ"]
    keys += ["\t".join(["Frame", "Time"][:before] + axes)] * heads
    # A lost marker is written as zeros.
    rows = [
        "\t".join([str(k + 1), f"{TIMES[k]:.5f}"][:before] + [cell or "0.000" for cell in cells(WAYS[:, k])])
        for k in range(FRAMES)
    ]
    return "\r\n".join([*keys, *rows]) + "\r\n"


def tracker() -> str:
    head = ["Objects", f"{RATE:g}", ",,Wrist:Wrist,,,,,,Tool:Tool,,,,,", "Frame,Sub Frame" + ",RX,RY,RZ,TX,TY,TZ" * 2]
    head += [",,deg,deg,deg,mm,mm,mm,deg,deg,deg,mm,mm,mm"]
    rows = [
        ",".join([str(k + 1), "0", "1", "2", "3", *cells(WAYS[0, k]), "1", "2", "3", *cells(WAYS[1, k])])
        for k in range(FRAMES)
    ]
    return "\n".join([*head, *rows]) + "\n"


MAKERS = {
    "qualisys.tsv": qualisys,
    "bare.tsv": lambda: qualisys(before=0, heads=False),
    "later.tsv": lambda: "FILE_VERSION\t2.0.0\r\n" + qualisys(),
    "frames.tsv": lambda: qualisys(before=1),
    "tracker.csv": tracker,
    "part.trc": lambda: trc().replace("X1\tY1\tZ1\tX2\tY2\tZ2", "X5\tY5\tZ5\tX9\tY9\tZ9"),
}


@pytest.mark.parametrize("name", MAKERS)
def test_a_makers_file_is_read_as_it_was_recorded(file: Make, name: str) -> None:
    (way,) = read(file(MAKERS[name](), name), Choices(marker="Tool", up_axis="z"))
    np.testing.assert_allclose(way.points, WAYS[1] * 0.001, atol=1e-12)
    np.testing.assert_allclose(way.times, TIMES, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("take.tak", "export it from there as CSV"),
        ("gait.qtm", "only Qualisys Track Manager reads"),
        ("walk.x2d", "export it from there as C3D"),
        ("all.zip", "unpack it; these can be read"),
        ("plan.ods", "save it as CSV; these can be read"),
    ],
)
def test_a_known_file_of_another_program_is_named_with_the_way_out(file: Make, name: str, remedy: str) -> None:
    with pytest.raises(ReaderError, match=remedy):
        read(file(b"\x00\x01", name))


HEAD = "t_ms;x_mm;y_mm\n"


@pytest.mark.parametrize(
    ("content", "points"),
    [
        ("sep=;\nt_s;x_mm;y_mm\n0;10,5;20\n1;11;21\n", [[0.0105, 0.020], [0.011, 0.021]]),
        ('"sep=,"\r\nt_s,x_mm,y_mm\r\n0,10.5,20\r\n1,11,21\r\n', [[0.0105, 0.020], [0.011, 0.021]]),
        ("sep=\t\nt_s\tx_mm\ty_mm\n0\t10,5\t20\n1\t11\t21\n", [[0.0105, 0.020], [0.011, 0.021]]),
        ("\n\nt_s,x_mm,y_mm\n0,10.5,20\n1,11,21\n", [[0.0105, 0.020], [0.011, 0.021]]),
        ("time (seconds),X (Millimeters),Y (Millimeters)\n0,10.5,20\n1,11,21\n", [[0.0105, 0.020], [0.011, 0.021]]),
        ("t_µs,x_cm,y_cm\n0,1.05,2\n1000000,1.1,2.1\n", [[0.0105, 0.020], [0.011, 0.021]]),
        ('t_s,x_mm,y_mm\n0,"10.5","20"\n1,11,21\n', [[0.0105, 0.020], [0.011, 0.021]]),
    ],
)
def test_other_countries_and_spreadsheets_write_the_same(file: Make, content: str, points: list[list[float]]) -> None:
    (stroke,) = read(file(content))
    np.testing.assert_allclose(stroke.points, points, rtol=1e-12)
    assert stroke.times.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(
    ("content", "line", "words"),
    [
        (HEAD + "990;1,5;2\n1.000;1,6;2\n1.010;1,7;2\n", 2, "column 2 holds '1,5' and column 1 of line 3 '1.000'"),
        (HEAD + "1.010;1,5;2\n1.020;1,6;2\n", 2, "a comma and a point cannot both be decimal; export it without sep"),
        (HEAD + "0;1.234,5;2\n1;2;3\n", 2, "export it without separators between thousands"),
        ("t_s,x_mm,y_mm\n0,1'234.5,2\n1,2,3\n", 2, "export it without separators between thousands"),
        ('t_s,x_mm,y_mm\n0,"1,234.5",2\n1,2,3\n', 2, "export it without separators between thousands"),
        ("t_s;x_mm;y_mm\n0;1 234,5;2\n1;2;3\n", 2, "export it without separators between thousands"),
        ("t_s,x_mm,y_mm\n12:30:01.5,1,2\n12:30:01.6,2,3\n", 2, "write times as seconds from the start, as in t_s"),
        ("t_s,x,y\n0,10 mm,2 mm\n1,2,3\n", 2, "write the unit into the name of the column, as in x_mm"),
        ("t_s,x_inch,y_inch\n0,1,2\n1,2,3\n", 1, "an inch has 25.4 mm"),
        ("t_s,x [in],y [in]\n0,1,2\n1,2,3\n", 1, "the unit of x is 'in'; use one of m, cm, mm: an inch has 25.4 mm"),
        ("t [min],x_mm,y_mm\n0,1,2\n1,2,3\n", 1, "the unit of t is 'min'; use one of s, ms, us, ns"),
        ("sep=|\nt_s|x_mm|y_mm\n0|1|2\n", 1, "its cells are separated by '|'"),
        ("sep=;\nt_s;x_mm;y_mm\n0;1;2\n1;zwei;3\n", 4, "column 2 holds 'zwei'"),
        ('t_s,x_mm,y_mm\n0,"1,2\n1,2,3\n', 2, "a quote is opened and not closed; close it"),
        ('t_s,x_mm,y_mm\n0,1,"' + "2" * 200_000 + '"\n', 2, "a line with quotes has 200006 characters"),
        ("t,x,y,qx,qy,qz,qw\n0,0,0,0,0,0,1\n1,0,0,0,0,0.7071,0\n", 3, "0, 0, 0.7071, 0 has length 0.707, not length 1"),
        ("t,x,y,qx,qy,qz,qw\n0,0,0,0,0,0,1\n1,1,0,0,0,,0\n", 3, "of the quaternion a part is missing"),
        ("t_s,x_mm,y_mm\n0,1,2\n1,\x00,2\n", 3, "which is not a number"),
        (",".join(f"c{k}" for k in range(1_000_000)) + "\n", None, "it has 1000000 columns; cut out what is needed"),
    ],
    ids=lambda value: ascii(value)[:40],
)
def test_what_is_ambiguous_is_refused_with_its_place_and_a_remedy(
    file: Make, content: str, line: int | None, words: str
) -> None:
    with pytest.raises(ReaderError) as refusal:
        read(file(content))
    assert refusal.value.line == line
    assert words in str(refusal.value)


def test_a_tool_that_was_not_seen_needs_no_turn(file: Make) -> None:
    lines = ["t,x,y,z,qx,qy,qz,qw", *(f"{k / 100},{0.3 + k / 1000},0.2,0.1,0,0,0.7071,0.7071" for k in range(9))]
    lines[4], lines[5] = "0.03,0,0,0,0,0,0,0", "0.04,,,,,,,"
    (stroke,) = read(file("\n".join(lines)))
    assert np.flatnonzero(np.isnan(stroke.points).any(axis=1)).tolist() == [3, 4]
    assert stroke.orientations is not None
    np.testing.assert_allclose(np.linalg.norm(stroke.orientations, axis=1), 1.0)


def c3d_of(frames: int, *, named: int, actual: bool, markers: int = 1, analogs: int = 0, scale: float = -0.01) -> bytes:
    """Return a C3D of so many frames, written as systems do whose counts of 16 bits end at 65,535."""

    def entry(name: bytes, group: int, body: bytes) -> bytes:
        return struct.pack("<bb", len(name), group) + name + struct.pack("<H", len(body) + 2) + body

    def parameter(name: bytes, group: int, kind: int, sizes: list[int], data: bytes) -> bytes:
        return entry(name, group, struct.pack("<bB", kind, len(sizes)) + bytes(sizes) + data + b"\0")

    names = b"".join(f"M{k:03d}".encode() for k in range(markers))
    told = entry(b"POINT", -1, b"\0") + parameter(b"USED", 1, 2, [], struct.pack("<H", markers))
    told += parameter(b"SCALE", 1, 4, [], struct.pack("<f", scale)) + parameter(b"UNITS", 1, -1, [2], b"mm")
    told += parameter(b"RATE", 1, 4, [], struct.pack("<f", 200)) + parameter(b"LABELS", 1, -1, [4, markers], names)
    told += parameter(b"FRAMES", 1, 2, [], struct.pack("<H", named))
    if actual:
        told += entry(b"TRIAL", -3, b"\0")
        told += parameter(b"ACTUAL_START_FIELD", 3, 2, [2], struct.pack("<2H", 1, 0))
        told += parameter(b"ACTUAL_END_FIELD", 3, 2, [2], struct.pack("<2H", frames % 65536, frames // 65536))
    parameters = (struct.pack("<4B", 1, 80, 2, 84) + told + b"\0\0").ljust(1024, b"\0")
    head = struct.pack("<BB5HfHHf", 2, 80, markers, analogs, 1, min(frames, 65535), 10, scale, 4, 0, 200.0)
    real = scale < 0
    values = np.zeros((frames, 4 * markers + analogs), "<f4" if real else "<i2")
    for k in range(markers):
        values[:, 4 * k] = (np.arange(frames) * 0.001 if real else np.arange(frames) % 20_000) + 1 + k
    return head.ljust(512, b"\0") + parameters + values.tobytes() + b"\0" * (-values.nbytes % 512)


@given(
    frames=st.one_of(st.integers(2, 300), st.integers(65_500, 66_000), st.integers(131_000, 140_000)),
    actual=st.booleans(),
    full=st.sampled_from([65_535, "wrapped", "clamped"]),
    layout=st.sampled_from([(1, 0, -0.01), (3, 0, -0.01), (2, 5, -0.01), (1, 0, 0.01), (3, 8, 0.01)]),
)
@settings(deadline=None, max_examples=40)
def test_no_frame_of_a_c3d_is_lost_or_made_up(
    tmp_path_factory: pytest.TempPathFactory, frames: int, actual: bool, full: Any, layout: tuple[int, int, float]
) -> None:
    markers, analogs, scale = layout
    named = {"wrapped": frames % 65_536, "clamped": min(frames, 65_535)}.get(full, 65_535)
    content = c3d_of(frames, named=named, actual=actual, markers=markers, analogs=analogs, scale=scale)
    path = tmp_path_factory.getbasetemp() / "counted.c3d"
    path.write_bytes(content)
    (way,) = read(path, Choices(marker="M000"))
    assert len(way.times) == frames
    assert np.isfinite(way.points).all()


def test_a_c3d_with_more_or_less_than_it_says_is_refused(file: Make) -> None:
    whole = c3d_of(300, named=300, actual=False)
    assert len(read(file(whole + bytes(2048), "zeros.c3d"))[0].times) == 300
    with pytest.raises(ReaderError, match="it says that it holds 300 frames, and has room for 448"):
        read(file(whole + b"\x07" * 2048, "more.c3d"))
    with pytest.raises(ReaderError, match="it may be cut off"):
        read(file(whole[:-1024], "less.c3d"))
    with pytest.raises(ReaderError, match="it may be cut off"):
        read(file(c3d_of(70_000, named=65_535, actual=True)[:900_000], "long.c3d"))
    forces = bytearray(c3d_of(300, named=300, actual=False, markers=1))
    forces[2:4] = b"\0\0"
    with pytest.raises(ReaderError, match="forces or other signals and no markers; export it with trajectories"):
        read(file(bytes(forces), "forces.c3d"))


def bag(path: Path, stamps: list[int], places: list[float], *, packer: Callable[[bytes], bytes] | None = None) -> Path:
    """Record points on one topic into a ROS 1 bag; ``packer`` packs its chunk."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS1_NOETIC)
    kinds: Any = store.types
    point, header = kinds["geometry_msgs/msg/PointStamped"], kinds["std_msgs/msg/Header"]
    writer: Any = Writer(path)
    if packer is not None:
        writer.set_compression(Writer.CompressionFormat.BZ2)
        writer.compressor = packer
    with writer:
        connection = writer.add_connection("/tool", point.__msgtype__, typestore=store)
        for number, (stamp, x) in enumerate(zip(stamps, places, strict=True)):
            when = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            place = kinds["geometry_msgs/msg/Point"](x=x, y=0.3, z=0.1)
            message = point(header=header(seq=number, stamp=when, frame_id="plate"), point=place)
            writer.write(connection, 10**18 + number, store.serialize_ros1(message, point.__msgtype__))
    return path


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        ([10, 20, 40, 30, 50], "message 4 on /tool is stamped 0.01 s before the one before it; leave it out"),
        ([10, 20, 20, 30, 40], "message 3 on /tool has the stamp of the one before it and another position"),
        ([50, 40, 30, 20, 10], "message 2 on /tool is stamped 0.01 s before"),
        ([0, 0, 0, 0, 0], "no message on /tool has a stamp; let its publisher fill header.stamp"),
    ],
)
def test_stamps_that_do_not_rise_are_told_by_message(tmp_path: Path, stamps: list[int], words: str) -> None:
    path = bag(tmp_path / "stamps.bag", [stamp * 10**6 for stamp in stamps], [0.1, 0.2, 0.3, 0.4, 0.5])
    with pytest.raises(ReaderError, match=words):
        read(path)


def test_a_message_sent_twice_is_one(tmp_path: Path) -> None:
    path = bag(tmp_path / "twice.bag", [10**7, 2 * 10**7, 2 * 10**7, 3 * 10**7], [0.1, 0.2, 0.2, 0.3])
    (way,) = read(path)
    assert way.points[:, 0].tolist() == [0.1, 0.2, 0.3]


def with_zeros(raw: bytes) -> bytes:
    """Return a chunk packed together with half a gigabyte of zeros, which take twice that while they are unpacked."""
    return bz2.compress(raw) + 25 * bz2.compress(bytes(20_000_000))


def peak() -> int:
    """Return the memory in bytes that this process holds at most so far."""
    told = Path("/proc/self/status").read_text()
    return 1024 * int(told.partition("VmHWM:")[2].split()[0])


def test_a_small_file_of_gigabytes_costs_nobody_else_memory(tmp_path: Path, file: Make) -> None:
    """A bag and a MATLAB file that unpack to a multiple of their size."""
    bomb = bag(tmp_path / "bomb.bag", [10**7, 2 * 10**7], [0.1, 0.2], packer=with_zeros)
    assert bomb.stat().st_size < 10_000
    before = peak()
    with pytest.raises(
        ReaderError, match=r"^Montag.bag: it takes more than 1000 MB of memory to read; export it again"
    ):
        read_upload("Montag.bag", bomb.read_bytes())
    assert peak() - before < 50_000_000
    from scipy.io import savemat

    packed = io.BytesIO()
    savemat(packed, {"demos": np.zeros(9 * 10**6)}, do_compression=True)
    with pytest.raises(ReaderError, match="it unpacks to more than 64 MB"):
        read_apart(file(packed.getvalue(), "zeros.mat"))


def test_what_is_no_file_or_crashes_its_reader_is_one_sentence(tmp_path: Path, file: Make) -> None:
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    good = file("t_s,x_m,y_m\n0,0.1,0.2\n1,0.2,0.3\n")
    with Reader() as reader:
        for name, words in (
            ("pipe.csv", "it is no file but a folder, a pipe or a device; name a file"),
            ("folder.csv", "it is a folder; name the files in it"),
            ("gone.csv", "No such file"),
        ):
            with pytest.raises(ReaderError, match=words):
                reader.read(tmp_path / name)
        assert len(reader.read(good)[0].times) == 2
        process = reader._process
        assert process is not None
        process.kill()
        with pytest.raises(ReaderError, match="its reader crashed; the file is damaged"):
            reader.read(good)
        assert len(reader.read(good)[0].times) == 2


def test_what_a_process_read_is_what_stands_in_the_file(file: Make) -> None:
    path = file(
        "demonstration,t,x,y,qx,qy,qz,qw\na,0,0.1,0.2,0,0,0,1\na,1,,,0,0,0,1\nb,0,0.3,0.4,0,0,1,0\nb,2,0.5,1,0,0,1,0\n"
    )
    for here, there in zip(read(path), read_apart(path), strict=True):
        assert (here.demonstration_id, here.source) == (there.demonstration_id, there.source)
        for name in ("times", "points", "triggers", "orientations"):
            np.testing.assert_array_equal(getattr(here, name), getattr(there, name))


def test_a_reader_that_never_ends_is_ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:

    monkeypatch.setattr(isolation, "LONGEST", 0.2)
    monkeypatch.setattr(isolation, "sys", type("Endless", (), {"executable": str(tmp_path / "endless")}))
    (tmp_path / "endless").write_text("#!/bin/sh\nexec sleep 60\n")
    (tmp_path / "endless").chmod(0o700)
    began = time.monotonic()
    with pytest.raises(ReaderError, match="it cannot be read within 60 s"):
        read_apart(tmp_path / "x.csv")
    assert time.monotonic() - began < 30

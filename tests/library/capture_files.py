"""Motion-capture files written as their makers write them: two markers, of which the second is lost for a while."""

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

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


FORMATS: dict[str, Callable[[], str]] = {
    "vicon.csv": vicon,
    "tabs.trc": trc,
    "commas.trc": lambda: trc(","),
    "motive.csv": motive,
}


def c3d_file(path: Path) -> Path:
    """Write a C3D."""
    import ezc3d

    content: Any = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["Wrist", "Tool"]
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    points = np.ones((4, 2, FRAMES))
    points[:3] = WAYS.transpose(2, 0, 1)
    content["data"]["points"] = points
    content.write(str(path))
    return path


def c3d_by_the_standard(path: Path, *, scale: float) -> Path:
    """Write a C3D byte by byte, by the C3D file format's user guide (Motion Lab Systems), without anybody's library.

    A positive ``scale`` (mm) stores 16-bit integers, as camera systems do, a negative one 32-bit floats.
    """

    def entry(name: str, group: int, body: bytes) -> bytes:
        return bytes([len(name), group & 0xFF]) + name.encode() + struct.pack("<H", len(body) + 3) + body + b"\0"

    def parameter(name: str, kind: int, sizes: list[int], values: bytes) -> bytes:
        return entry(name, 1, struct.pack("<bB", kind, len(sizes)) + bytes(sizes) + values)

    entries = entry("POINT", -1, b"") + b"".join(
        (
            parameter("USED", 2, [], struct.pack("<h", 2)),
            parameter("FRAMES", 2, [], struct.pack("<h", FRAMES)),
            parameter("SCALE", 4, [], struct.pack("<f", scale)),
            parameter("DATA_START", 2, [], struct.pack("<h", 3)),
            parameter("RATE", 4, [], struct.pack("<f", RATE)),
            parameter("UNITS", -1, [4], b"mm  "),
            parameter("LABELS", -1, [8, 2], b"Wrist   Tool    "),
        )
    )
    head = bytearray(512)
    head[:2] = bytes([2, 0x50])
    struct.pack_into("<5H", head, 2, 2, 0, 1, FRAMES, 10)
    struct.pack_into("<fHHf", head, 12, scale, 3, 0, RATE)
    parameters = (bytes([1, 0x50, 1, 84]) + entries).ljust(512, b"\0")
    assert len(parameters) == 512
    data = b""
    for points in WAYS.transpose(1, 0, 2):
        for x, y, z in points.tolist():
            seen = np.isfinite([x, y, z]).all()
            place = [x, y, z] if seen else [0.0, 0.0, 0.0]
            if scale < 0.0:
                data += struct.pack("<4f", *place, 0.0 if seen else -1.0)
            else:
                data += struct.pack("<3hH", *(round(value / scale) for value in place), 0 if seen else 0xFFFF)
    path.write_bytes(bytes(head) + parameters + data.ljust(-(-len(data) // 512) * 512, b"\0"))
    return path


def rosbag_folder(folder: Path, storage: str) -> Path:
    """Record both markers' way of the second one on two topics; ``storage`` is SQLITE3 or MCAP."""
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    store: Any = get_typestore(Stores.ROS2_HUMBLE)
    kinds: Any = store.types
    pose, header = kinds["geometry_msgs/msg/PoseStamped"], kinds["std_msgs/msg/Header"]
    with rosbag2.Writer(folder, version=8, storage_plugin=getattr(rosbag2.StoragePlugin, storage)) as writer:
        for topic in ("/tool", "/wrist"):
            connection = writer.add_connection(topic, pose.__msgtype__, typestore=store)
            for i in range(FRAMES):
                nanoseconds = 1_700_000_000_000_000_000 + round(TIMES[i] * 1e9)
                x, y, z = (WAYS[1, i] * 0.001).tolist()
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
    return folder

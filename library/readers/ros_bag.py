"""ROS bags (``.bag``, ``.db3``, ``.mcap`` or their folder), through rosbags (extra ``formats``), without ROS.

Read are topics of ``geometry_msgs`` PoseStamped, PointStamped and TransformStamped, by the time in their headers.
"""

from functools import reduce
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from library.errors import ReaderError
from library.readers.import_options import Choices
from library.readers.tracks import Track, follow, pick
from models.demonstration import Demonstration

POSITIONS: dict[str, tuple[str, ...]] = {
    "geometry_msgs/msg/PoseStamped": ("pose", "position"),
    "geometry_msgs/msg/PointStamped": ("point",),
    "geometry_msgs/msg/TransformStamped": ("transform", "translation"),
}
Sample = tuple[int, tuple[float, float, float]]
ONE_SOURCE = "leave it out, or record it again with one publisher and one clock"
AGAIN = "record it again, or convert it with rosbags-convert"


def read(path: Path, choices: Choices) -> list[Demonstration]:
    """Return the way told on the chosen topic; ROS has z up and metres (REP 103)."""
    if find_spec("rosbags") is None:
        raise ReaderError(path, "ROS bags need the package rosbags", "install opcua-skill[formats]")
    from rosbags.highlevel import AnyReader  # pyright: ignore[reportMissingImports]
    from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

    try:
        store: Any = get_typestore(Stores.LATEST)
        with AnyReader([_recording(path)], default_typestore=store) as bag:
            connections = [one for one in bag.connections if one.msgtype in POSITIONS]
            topics = sorted({one.topic for one in connections})
            topic = topics[pick(path, topics, choices.topic, "topic")]
            samples: list[Sample] = []
            for connection, _, raw in bag.messages([one for one in connections if one.topic == topic]):
                message: Any = bag.deserialize(raw, connection.msgtype)
                place: Any = reduce(getattr, POSITIONS[connection.msgtype], message)
                nanoseconds = int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)
                samples.append((nanoseconds, (float(place.x), float(place.y), float(place.z))))
    except (ReaderError, MemoryError):
        raise
    except Exception as error:
        # The parsers meet damage with whatever exception happens: struct, sqlite3, yaml, lz4 and assertions among them.
        raise ReaderError(path, f"it cannot be read ({error})", AGAIN) from error
    if not samples:
        raise ReaderError(path, f"nothing was recorded on {topic}", AGAIN)
    samples = _in_order(path, topic, samples)
    start = samples[0][0]
    times = np.array([(stamp - start) * 1e-9 for stamp, _ in samples])
    points = np.array([place for _, place in samples])
    points[~np.isfinite(points).all(axis=1)] = np.nan
    return follow(path, [Track(topic, times, points)], Choices(up_axis=choices.up_axis))


def _in_order(path: Path, topic: str, samples: list[Sample]) -> list[Sample]:
    """Return the samples without those sent twice, or complain of stamps that do not rise: which message, and how far.

    Which of two stamps is wrong, nobody can tell afterwards: nothing is sorted.
    """
    if len(samples) > 1 and all(stamp == 0 for stamp, _ in samples):
        remedy = "let its publisher fill header.stamp and record it again"
        raise ReaderError(path, f"no message on {topic} has a stamp", remedy)
    kept = samples[:1]
    for number, sample in enumerate(samples[1:], 2):
        if sample == kept[-1]:
            continue
        back = (kept[-1][0] - sample[0]) * 1e-9
        if back == 0.0:
            told = f"message {number} on {topic} has the stamp of the one before it and another position"
            raise ReaderError(path, told, ONE_SOURCE)
        if back > 0.0:
            told = f"message {number} on {topic} is stamped {back:g} s before the one before it"
            raise ReaderError(path, told, ONE_SOURCE)
        kept.append(sample)
    return kept


def _recording(path: Path) -> Path:
    """Return the folder of a ROS 2 recording of which a file was named, or else what was named: a file may be alone."""
    if path.is_dir() or path.suffix == ".bag" or not (path.parent / "metadata.yaml").exists():
        return path
    return path.parent

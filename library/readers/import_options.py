"""What a file may leave open and the person who reads it has to say."""

from dataclasses import dataclass
from typing import Literal

UpAxis = Literal["x", "y", "z"]


@dataclass(frozen=True, slots=True)
class Choices:
    """How to read files that leave something open.

    ``marker``: name of the marker or rigid body to follow, needed where a file holds several. ``up_axis``: which axis
    of the file points up, "" for what the format says or, where it says nothing, z. ``unit``: unit of positions where
    the file names none, "" for metres. ``topic``: topic of a ROS bag, needed where several carry poses.
    """

    marker: str = ""
    up_axis: UpAxis | Literal[""] = ""
    unit: str = ""
    topic: str = ""

"""Which drivers there are: ours, and those that installed distributions bring by entry point."""

from collections.abc import Mapping
from functools import cache
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    from sim.arm import Arm
    from sim.arm_model import ArmModel
    from sim.testing.disturbances import Imperfection

DOOR = "opcua_skill.arms"
SIMULATIONS = ("pybullet", "kinematic")


class Driver(Protocol):
    """What an entry point of the group ``opcua_skill.arms`` names: a class or function that makes an arm."""

    def __call__(self, model: "ArmModel", settings: Mapping[str, Any]) -> "Arm":
        """Return the arm, not yet open; ``settings`` are the workstation's ``driver_settings``.

        Raises ``ValueError`` with one sentence where they are wrong.
        """
        ...


@cache
def driver_names() -> tuple[str, ...]:
    """Return the names of all drivers, ours first."""
    return (*SIMULATIONS, *sorted({entry.name for entry in entry_points(group=DOOR)} - set(SIMULATIONS)))


def driver_named(name: str) -> Driver:
    """Return a driver that an installed distribution brings."""
    (entry,) = entry_points(group=DOOR, name=name)
    return entry.load()


def simulation(name: str, model: "ArmModel", *, realtime: bool, imperfection: "Imperfection | None" = None) -> "Arm":
    """Return a simulated arm: in PyBullet, or by kinematics alone. Nothing of PyBullet is imported before."""
    if name == "kinematic":
        from sim.drivers.kinematic.arm import KinematicArm

        return KinematicArm(model, realtime=realtime, imperfection=imperfection)
    from sim.drivers.pybullet.arm import PyBulletArm

    return PyBulletArm(model, realtime=realtime, imperfection=imperfection)

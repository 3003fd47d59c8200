"""Which class moves which workstation: the only place of the product that knows there is a PyBullet."""

from opcua_skill.commands.faults import Fault
from opcua_skill.settings import Settings
from sim.arm import Arm
from sim.arms import load, names
from sim.imperfection import Imperfection


class Arms:
    """Makes the arm of a workstation, or a fresh simulation beside it that runs as fast as it can."""

    def __init__(self, settings: Settings) -> None:
        for station in settings.workstations:
            if station.arm not in names():
                raise Fault(
                    f"workstation {station.name}: there is no arm {station.arm!r}, known are {', '.join(names())}"
                )
        self._stations = {station.name: station for station in settings.workstations}

    def __call__(self, workstation: str, simulation: bool) -> Arm:
        """Return an arm, not yet open."""
        station = self._stations[workstation]
        realtime = station.realtime and not simulation
        model = load(station.arm)
        worse = Imperfection(**station.imperfection.model_dump()) if any(station.imperfection.sizes) else None
        if station.driver == "pybullet":
            from sim.pybullet_arm import PyBulletArm as ArmOfDriver
        else:
            from sim.kinematic_arm import KinematicArm as ArmOfDriver
        return ArmOfDriver(model, realtime=realtime, imperfection=None if simulation else worse)

"""Which class moves which workstation: the only place of the product that knows there is a PyBullet."""

from opcua_skill.commands.faults import Fault
from opcua_skill.jobs.station import model_of
from opcua_skill.settings import Settings
from sim.arm import Arm
from sim.imperfection import Imperfection


class Arms:
    """Makes the arm of a workstation, or a fresh simulation beside it that runs as fast as it can."""

    def __init__(self, settings: Settings) -> None:
        for station in settings.workstations:
            try:
                model_of(station)
            except ValueError as wrong:
                raise Fault(f"workstation {station.name}: {wrong}") from None
        self._stations = {station.name: station for station in settings.workstations}

    def __call__(self, workstation: str, simulation: bool) -> Arm:
        """Return an arm, not yet open."""
        station = self._stations[workstation]
        realtime = station.realtime and not simulation
        model = model_of(station)
        worse = Imperfection(**station.imperfection.model_dump()) if any(station.imperfection.sizes) else None
        if station.driver == "pybullet":
            from sim.pybullet_arm import PyBulletArm as ArmOfDriver
        else:
            from sim.kinematic_arm import KinematicArm as ArmOfDriver
        return ArmOfDriver(model, realtime=realtime, imperfection=None if simulation else worse)

"""Which arm moves which workstation."""

from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.configuration.settings import Settings
from opcua_skill.jobs.station import model_of
from sim.arm import Arm
from sim.drivers import SIMULATIONS, driver_named, simulation
from sim.testing.disturbances import Imperfection


class Arms:
    """Makes the arm of a workstation, or a fresh simulation beside it that runs as fast as it can."""

    def __init__(self, settings: Settings) -> None:
        for station in settings.workstations:
            try:
                model_of(station)
            except ValueError as wrong:
                raise Fault(f"workstation {station.name}: {wrong}") from None
        self._stations = {station.name: station for station in settings.workstations}

    def __call__(self, workstation: str, simulated: bool) -> Arm:
        """Return an arm, not yet open. Beside one that is no simulation, PyBullet simulates."""
        station = self._stations[workstation]
        model = model_of(station)
        if station.driver not in SIMULATIONS and not simulated:
            try:
                return driver_named(station.driver)(model, station.driver_settings)
            except ValueError as wrong:
                raise Fault(f"workstation {workstation}: {wrong}") from None
        worse = Imperfection(**station.imperfection.model_dump()) if any(station.imperfection.sizes) else None
        return simulation(
            station.driver,
            model,
            realtime=station.realtime and not simulated,
            imperfection=None if simulated else worse,
        )

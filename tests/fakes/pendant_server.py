"""A real server whose arm has a pendant that a test holds: `python -m tests.fakes.pendant_server FOLDER ENDPOINT`.

What a hand does to the arm comes in on stdin, one word a line; every motion that begins is written into ``began`` in
the folder, with the machine's monotonic clock, before it begins. Where the arm stands is kept in ``stands``, as a real
arm stays where a killed server left it.
"""

import asyncio
import sys
import time
from pathlib import Path

from opcua_skill.server import SkillServerApp
from opcua_skill.settings import Settings, Workstation
from sim.arms import load
from tests.fakes.pendant_arm import PendantArm

SECONDS_OF_A_MOTION = 0.6


class KeptArm(PendantArm):
    """An arm whose place outlives the server's process."""

    def __init__(self, folder: Path) -> None:
        self._stands = folder / "stands"
        away = self._stands.exists() and self._stands.read_text() == "away"
        super().__init__(load("panda"), self._begins, away=away, seconds=SECONDS_OF_A_MOTION)
        self._began = (folder / "began").open("a", buffering=1)

    def _begins(self, kind: str, digest: str) -> None:
        self._began.write(f"{time.monotonic_ns()} {kind} {digest}\n")
        self._stands.write_text("away")

    def arrive(self) -> None:
        super().arrive()
        self._stands.write_text("home" if self.state().joints == self.model.home else "away")

    def push(self) -> None:
        super().push()
        self._stands.write_text("away")


async def serve(folder: Path, endpoint: str) -> None:
    plant = Settings(data=folder / "data", endpoint=endpoint, workstations=(Workstation(driver="kinematic"),))
    arm = KeptArm(folder)
    loop, ended = asyncio.get_running_loop(), asyncio.Event()

    def obey() -> None:
        word = sys.stdin.readline().strip()
        if not word:
            loop.remove_reader(sys.stdin.fileno())
            ended.set()
            return
        getattr(arm, word)()
        print("done", flush=True)

    async with SkillServerApp(plant, lambda _, simulation: PendantArm(arm.model, print) if simulation else arm) as app:
        loop.add_reader(sys.stdin.fileno(), obey)
        print(f"listening on {app.endpoint}", flush=True)
        await ended.wait()


if __name__ == "__main__":
    asyncio.run(serve(Path(sys.argv[1]), sys.argv[2]))

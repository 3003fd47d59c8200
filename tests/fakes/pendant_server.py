"""A real server whose arm has a pendant that a test holds; it is forked from a process that has imported all it needs.

What a hand does to the arm comes in by a pipe, one word at a time; every motion that begins is written into ``began``
in the folder, with the machine's monotonic clock, before it begins. Where the arm stands is kept in ``stands``, as a
real arm stays where a killed server left it.
"""

import asyncio
import os
import time
from multiprocessing.connection import Connection
from pathlib import Path

from opcua_skill.configuration.settings import Settings, Workstation
from opcua_skill.server.app import SkillServerApp
from sim.robots import load
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


def serve_apart(folder: Path, endpoint: str, hand: Connection) -> None:
    """Serve in a process of its own until the other end of ``hand`` is closed, or the process is killed."""
    os.setsid()
    with (folder / "log").open("a") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
    asyncio.run(serve(folder, endpoint, hand))


async def serve(folder: Path, endpoint: str, hand: Connection) -> None:
    plant = Settings(data=folder / "data", endpoint=endpoint, workstations=(Workstation(driver="kinematic"),))
    arm = KeptArm(folder)
    loop, ended = asyncio.get_running_loop(), asyncio.Event()

    def obey() -> None:
        try:
            word = hand.recv()
        except EOFError:
            loop.remove_reader(hand.fileno())
            ended.set()
            return
        getattr(arm, word)()
        hand.send("done")

    async with SkillServerApp(plant, lambda _, simulation: PendantArm(arm.model, print) if simulation else arm) as app:
        loop.add_reader(hand.fileno(), obey)
        hand.send(f"listening on {app.endpoint}")
        await ended.wait()

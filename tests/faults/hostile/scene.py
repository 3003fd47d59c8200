"""A server under attack, a witness beside it, and what must hold while it lasts and after it."""

import asyncio
import json
import os
import subprocess
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

PAGE = os.sysconf("SC_PAGE_SIZE")
MIB = 1024 * 1024
READS_FOR_A_PERCENTILE = 100


@dataclass
class Scene:
    """``reads`` and ``sign_ins`` are the seconds the witness's requests took, as they happen."""

    url: str
    index: int
    folder: Path
    server_pid: int
    reads: list[float] = field(default_factory=list)
    sign_ins: list[float] = field(default_factory=list)
    started_with: int = 0

    @property
    def address(self) -> tuple[str, int]:
        host, _, port = self.url.removeprefix("opc.tcp://").partition("/")[0].partition(":")
        return host, int(port)

    def memory(self) -> int:
        """Return the resident bytes of the server."""
        return int(Path(f"/proc/{self.server_pid}/statm").read_text().split()[1]) * PAGE

    def log(self) -> str:
        return (self.folder / "server.log").read_text()

    @asynccontextmanager
    async def attack(self) -> AsyncIterator[None]:
        """Hold the server to its promises while the block runs: the witness is served, memory stays, no traceback."""
        self.reads.clear()
        self.sign_ins.clear()
        yield
        await self.witnessed(reads=20, sign_ins=1)
        while len(self.reads) < READS_FOR_A_PERCENTILE:
            await self.witnessed(reads=10, sign_ins=0)
        ordered = sorted(self.reads)
        slowest = ordered[min(len(ordered) - 1, int(len(ordered) * 0.99))]
        assert slowest < 0.25 * crowding(), f"99 of 100 reads took up to {slowest * 1000:.0f} ms"
        assert max(self.sign_ins) < 5.0 * crowding(), f"a sign-in took {max(self.sign_ins):.1f} s"
        grown = (self.memory() - self.started_with) / MIB
        assert grown < 64, f"the server grew by {grown:.0f} MiB"
        assert "Traceback" not in self.log(), self.log()[-3000:]

    async def witnessed(self, *, reads: int, sign_ins: int) -> None:
        """Wait until the witness has been served so and so often."""
        until_reads, until_sign_ins = len(self.reads) + reads, len(self.sign_ins) + sign_ins
        async with asyncio.timeout(30):
            while len(self.reads) < until_reads or len(self.sign_ins) < until_sign_ins:
                await asyncio.sleep(0.05)


@asynccontextmanager
async def scene(folder: Path) -> AsyncIterator[Scene]:
    """Start server and witness, and stop both."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}

    async def start(module: str, *arguments: str) -> asyncio.subprocess.Process:
        return await asyncio.create_subprocess_exec(
            sys.executable, "-m", module, *arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
        )

    server = await start("tests.faults.hostile.serving", str(folder))
    witness = None
    try:
        assert server.stdout is not None
        async with asyncio.timeout(60):
            told = json.loads(await server.stdout.readline())
        running = Scene(told["url"], told["index"], folder, server.pid)
        witness = await start("tests.faults.hostile.witness", told["url"], str(folder))
        listening = asyncio.create_task(_listen(witness, running))
        await running.witnessed(reads=100, sign_ins=2)
        running.started_with = running.memory()
        yield running
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)
    finally:
        for process in (witness, server):
            if process is not None and process.returncode is None:
                process.kill()
                await process.communicate()


async def _listen(witness: asyncio.subprocess.Process, running: Scene) -> None:
    assert witness.stdout is not None
    while line := await witness.stdout.readline():
        told = json.loads(line)
        if "read" in told:
            running.reads.append(told["read"])
        elif "sign_in" in told:
            running.sign_ins.append(told["sign_in"])


def crowding() -> float:
    """Return by how much longer everybody may wait than on a quiet machine of its own.

    A shared machine pauses for reasons of its own, and its load average tells of them late. A server that hangs is
    caught all the same: it hangs for tens of seconds.
    """
    return 4.0 * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))

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
READ_SECONDS, SIGN_IN_SECONDS, GROWTH_MIB = 0.25, 5.0, 64
FEW_READS = 20
Line = dict[str, float]


@dataclass
class Scene:
    """``reads`` and ``sign_ins`` are what the witness told since the attack began, ``all_reads`` since the start."""

    url: str
    index: int
    product: int
    folder: Path
    server_pid: int
    witness: asyncio.subprocess.Process
    reads: list[Line] = field(default_factory=list)
    sign_ins: list[Line] = field(default_factory=list)
    all_reads: list[Line] = field(default_factory=list)
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
        before = self.turns()
        yield
        await self.signed_in_anew()
        await self.witnessed(reads=FEW_READS)
        longer = crowding(before, self.turns())
        served_in_time(self.reads, longer)
        slowest = max(one["sign_in"] for one in self.sign_ins)
        assert slowest < SIGN_IN_SECONDS * longer, (
            f"a sign-in took {slowest:.1f} s, everything {longer:.1f} times as long"
        )
        grown = (self.memory() - self.started_with) / MIB
        assert grown < GROWTH_MIB, f"the server grew by {grown:.0f} MiB"
        assert "Traceback" not in self.log(), self.log()[-3000:]

    def turns(self) -> list[tuple[int, int]]:
        """Return the nanoseconds that server and witness have run so far, and have waited for a processor."""
        told = [Path(f"/proc/{pid}/schedstat").read_text().split() for pid in (self.server_pid, self.witness.pid)]
        return [(int(run), int(waited)) for run, waited, _ in told]

    async def witnessed(self, *, reads: int = 0, sign_ins: int = 0) -> None:
        """Wait until the witness has been served so and so often from now on."""
        until_reads, until_sign_ins = len(self.reads) + reads, len(self.sign_ins) + sign_ins
        async with asyncio.timeout(60):
            while len(self.reads) < until_reads or len(self.sign_ins) < until_sign_ins:
                await asyncio.sleep(0.01)

    async def signed_in_anew(self) -> None:
        """Have the witness sign in once more, from now on."""
        assert self.witness.stdin is not None
        before = len(self.sign_ins)
        self.witness.stdin.write(b"\n")
        async with asyncio.timeout(60):
            while not any(one["asked"] for one in self.sign_ins[before:]):
                await asyncio.sleep(0.01)


def crowding(before: list[tuple[int, int]], after: list[tuple[int, int]]) -> float:
    """Return how many times as long everything took as on processors of one's own, from the kernel's own account."""
    spans = [(end[0] - start[0], end[1] - start[1]) for start, end in zip(before, after, strict=True)]
    return max((run + waited) / run for run, waited in spans)


def served_in_time(reads: list[Line], longer: float) -> None:
    """Check that 99 of 100 reads were answered within 250 ms; of a few, all but one.

    Where others use the machine, the time is as many times longer as server or witness had to wait for a processor,
    and twice what the machine was late to wake the witness comes to it. A server that hangs is caught there too.
    """
    limit = READ_SECONDS * longer + 2 * max(one["late"] for one in reads)
    slow = [one["read"] for one in reads if one["read"] > limit]
    told = f"{len(slow)} of {len(reads)} reads took up to {max(slow, default=0):.2f} s, more than {limit:.2f} s"
    assert len(slow) <= max(1, len(reads) // 100), told


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
        async with asyncio.timeout(120):
            told = json.loads(await server.stdout.readline())
        witness = await start("tests.faults.hostile.witness", told["url"], str(folder))
        running = Scene(told["url"], told["index"], told["product"], folder, server.pid, witness)
        listening = asyncio.create_task(_listen(witness, running))
        await running.witnessed(reads=100, sign_ins=2)
        running.started_with, begun = running.memory(), running.turns()
        running.all_reads.clear()
        yield running
        ended = running.turns()
        listening.cancel()
        await asyncio.gather(listening, return_exceptions=True)
        served_in_time(running.all_reads, crowding(begun, ended))
    finally:
        if witness is not None and witness.returncode is None:
            witness.kill()
            await witness.communicate()
        if server.returncode is None:
            assert server.stdin is not None
            server.stdin.close()  # it stops by itself, and its workers with it
            try:
                async with asyncio.timeout(20):
                    await server.wait()
            except TimeoutError:
                server.kill()
                await server.wait()


async def _listen(witness: asyncio.subprocess.Process, running: Scene) -> None:
    assert witness.stdout is not None
    while line := await witness.stdout.readline():
        told = json.loads(line)
        if "read" in told:
            running.reads.append(told)
            running.all_reads.append(told)
        elif "sign_in" in told:
            running.sign_ins.append(told)

"""The stage of the demo: a server in a process of its own, on a folder that is gone afterwards, security on."""

import asyncio
import contextlib
import importlib.util
import os
import secrets
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from opcua_skill.client import APPLICATION_URI, ClientError, SkillClient
from opcua_skill.security import TrustList, ensure_client_certificate

ROLES = {"teacher": "teacher", "engineer": "engineer", "mes": "operator", "visitor": "observer"}
START_LIMIT = 120.0
STOP_LIMIT = 20.0


class PlantFailed(ClientError):
    """The server of the demo did not start, or ended by itself."""


@dataclass(frozen=True, slots=True)
class Plant:
    """A running server and who may sign in there. ``client_folder`` holds the certificate that it trusts."""

    url: str
    client_folder: Path
    passwords: Mapping[str, str]

    def sign_in(self, user: str) -> SkillClient:
        """Return a client for one of the users, not yet connected."""
        return SkillClient(self.url, user, self.passwords[user], folder=self.client_folder)


@contextlib.asynccontextmanager
async def running_plant(arm: str, *, realtime: bool = True) -> AsyncIterator[Plant]:
    """Yield a plant with one workstation, ``ws1``. However the block ends, no process and no file is left."""
    folder = Path(tempfile.mkdtemp(prefix="opcua-skill-demo-"))
    try:
        passwords = {user: secrets.token_urlsafe(12) for user in ROLES}
        await set_up(folder, arm, realtime, passwords)
        async with serving(folder) as url:
            yield Plant(url, folder / "client", passwords)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


async def set_up(folder: Path, arm: str, realtime: bool, passwords: Mapping[str, str]) -> None:
    """Do what an administrator does before the first start: configuration, users, and the clients' certificate."""
    settings = f'[[workstations]]\nname = "ws1"\narm = "{arm}"\nrealtime = {str(realtime).lower()}\n'
    (folder / "plant.toml").write_text(settings, encoding="utf-8")
    rows = [f"{user},{role},{passwords[user]}" for user, role in ROLES.items()]
    await administer(folder, "users", "import", "-", typed="\n".join(["name,role,password", *rows]))
    mine = await asyncio.to_thread(ensure_client_certificate, folder / "client", APPLICATION_URI)
    TrustList(folder / "data" / "certificates").trust(mine.certificate_file)


def command(*words: str) -> tuple[str, ...]:
    """Return the command line of `opcua-skill`, by this very Python."""
    return (sys.executable, "-m", "opcua_skill.cli", *words)


async def administer(folder: Path, *words: str, typed: str = "") -> None:
    """Run one command on the data folder."""
    await finished(command(*words, "--data", str(folder / "data")), " ".join(words[:2]), {}, typed)


async def finished(words: Sequence[str], doing: str, more: Mapping[str, str], typed: str = "") -> None:
    """Run a command to its end; raise with its own sentence if it fails."""
    process = await asyncio.create_subprocess_exec(
        *words,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        env={**os.environ, **more},
        start_new_session=True,
    )
    try:
        async with asyncio.timeout(START_LIMIT):
            _, complaint = await process.communicate(f"{typed}\n".encode())
    except TimeoutError:
        raise PlantFailed(f"{doing} took longer than {START_LIMIT:g} s") from None
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    if process.returncode:
        raise PlantFailed(f"{doing}: {complaint.decode().strip().removeprefix('error: ')}")


@contextlib.asynccontextmanager
async def serving(folder: Path) -> AsyncIterator[str]:
    """Yield the address of a server on the folder; it stops when the block ends, or when this process does."""
    words = ("serve", "--config", str(folder / "plant.toml"), "--data", str(folder / "data"))
    more = ("--endpoint", "opc.tcp://127.0.0.1:0", "--until-stdin-closes")
    async with speaking(command(*words, *more), "listening on ", folder / "server.log", {}) as url:
        yield url


@contextlib.asynccontextmanager
async def panel_beside(plant: Plant) -> AsyncIterator[str]:
    """Yield the address of an operator panel for the plant, or why there is none."""
    if importlib.util.find_spec("nicegui") is None:
        yield "not installed: pip install 'opcua-skill[panel]'"
        return
    words = command("panel", "--server", plant.url, "--port", str(free_port()))
    trusted = {"OPCUA_SKILL_CLIENT_DIR": str(plant.client_folder)}
    async with speaking(words, "panel on ", plant.client_folder.parent / "panel.log", trusted) as url:
        yield url


def free_port() -> int:
    """Return a loopback port that nobody uses now."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return taken.getsockname()[1]


@contextlib.asynccontextmanager
async def speaking(words: Sequence[str], saying: str, log: Path, more: Mapping[str, str]) -> AsyncIterator[str]:
    """Yield what a process prints after the words ``saying``; it is gone, with all it started, when the block ends."""
    complaints = os.open(log, os.O_WRONLY | os.O_CREAT, 0o600)
    try:
        process = await asyncio.create_subprocess_exec(
            *words,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            stderr=complaints,
            start_new_session=True,
            env={**os.environ, **more},
        )
    finally:
        os.close(complaints)
    try:
        yield await heard(process, saying, log)
    finally:
        await asyncio.shield(stop(process))


async def heard(process: asyncio.subprocess.Process, saying: str, log: Path) -> str:
    """Return what follows ``saying`` in what a process prints."""
    assert process.stdout is not None
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(START_LIMIT):
            async for line in process.stdout:
                head, _, rest = line.decode().strip().partition(saying)
                if rest and not head:
                    return rest
    lines = (await asyncio.to_thread(log.read_text, "utf-8", "replace")).strip().splitlines()
    said = lines[-1].removeprefix("error: ") if lines else f"nothing heard for {START_LIMIT:g} s"
    raise PlantFailed(f"it did not start: {said}")


async def stop(process: asyncio.subprocess.Process) -> None:
    """Let a process stop by itself, then make sure that nothing of its process group is left."""
    if process.stdin is not None:
        process.stdin.close()
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGINT)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(process.wait(), STOP_LIMIT)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    await process.wait()

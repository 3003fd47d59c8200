"""A person at the panel: two OPC UA connections signed in as that person, and what they tell, kept fresh.

Requests of one connection are served one after another, so stopping and watching have a connection of their own: a
long call on the other one can never stand in front of Stop motion.
"""

import asyncio
import contextlib
import itertools
import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from opcua_skill.client import (
    ArmReading,
    ClientError,
    Event,
    JobReport,
    LockReading,
    NotSignedIn,
    QueueStatus,
    SkillClient,
    Unreachable,
)

log = logging.getLogger(__name__)

WATCH_EVERY = 0.25
JOBS_AT_LEAST_EVERY = 2.0
RETRY_EVERY = 1.0
WATCH_TIMEOUT = 4.0
WORK_TIMEOUT = 40.0
STOP_LIMIT = 3.0
SILENT_AFTER = 1.5
"""So long without an answer, in s, and what is shown is not called true any more."""
KEPT_HAPPENINGS = 500
SHOWN_JOBS = 50
RIGHTS = {
    "learn": "SkillLibrary/LearnFromDemonstration",
    "edit": "SkillLibrary/RemovePoints",
    "approve": "SkillLibrary/Approve",
    "deploy": "SkillLibrary/Deploy",
    "retire": "SkillLibrary/Retire",
    "import": "SkillLibrary/ImportSkill",
    "audit": "SkillLibrary/GetAuditTrail",
    "recipes": "SkillLibrary/PutRecipe",
    "read recipes": "SkillLibrary/ListRecipes",
}
STATION_RIGHTS = {
    "run": "ExecuteSkill",
    "stop": "Arm/ProtectiveStop",
    "reset": "Arm/Reset",
    "release": "Queue/ReleaseQueue",
    "lock": "Arm/Lock/InitLock",
    "break lock": "Arm/Lock/BreakLock",
    "record": "Recorder/StartRecording",
}
RENEW_BELOW = 300.0


@dataclass(frozen=True, slots=True)
class Happening:
    """One thing the server told, with the moment at which it reached the panel."""

    number: int
    at: datetime
    event: Event


@dataclass(frozen=True, slots=True)
class Station:
    """A workstation as last seen: ``arm`` is None while it cannot be read; ``jobs`` are the newest first."""

    name: str
    arm: ArmReading | None = None
    jobs: tuple[JobReport, ...] = ()
    lock: LockReading | None = None
    queue: QueueStatus | None = None

    @property
    def active(self) -> tuple[JobReport, ...]:
        """The jobs that have not ended, the running one last in the queue's order."""
        return tuple(job for job in self.jobs if not job.ended)


@dataclass(frozen=True, slots=True)
class StopOutcome:
    """Whether the server took the stop, how long it took in s, and if not, why."""

    taken: bool
    seconds: float
    reason: str = ""


@dataclass
class PanelSession:
    """Somebody signed in at a browser. ``connected`` says whether what is shown is true now.

    ``ended`` says why this is over: signed out, or the server does not let this person in any more.
    """

    url: str
    user: str
    password: str = field(repr=False)
    folder: Path | None = None
    connected: bool = False
    why_not: str = ""
    ended: str = ""
    language: str = "en"
    station_name: str = ""
    stations: dict[str, Station] = field(default_factory=dict)
    rights: frozenset[str] = frozenset()
    insecure: tuple[str, ...] = ()
    four_eyes: bool = True
    presets: tuple[str, ...] = ()
    happenings: deque[Happening] = field(default_factory=lambda: deque(maxlen=KEPT_HAPPENINGS))
    times_recovered: int = 0
    recovered_at: datetime | None = None
    kept: dict[object, object] = field(default_factory=dict)
    locked_here: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self._work: SkillClient | None = None
        self._watch: SkillClient | None = None
        self._watching: asyncio.Task[None] | None = None
        self._numbers = itertools.count(1)
        self._wake = asyncio.Event()
        self._jobs_due = 0.0
        self._heard = 0.0
        self._on_close: list[Callable[[], None]] = []

    async def open(self) -> None:
        """Sign in; raises ClientError when the server is not there or says no."""
        await self._connect()
        self._watching = asyncio.create_task(self._keep_watching(), name=f"panel watches for {self.user}")

    async def close(self) -> None:
        """Sign out: both connections end, and with them a lock on an arm."""
        self.ended = self.ended or "signed out"
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)
        await self._disconnect()
        self.password = ""
        for tell in self._on_close:
            tell()

    def on_close(self, tell: Callable[[], None]) -> None:
        """Have ``tell`` called once the session has ended."""
        self._on_close.append(tell)

    @property
    def client(self) -> SkillClient:
        """The connection for everything but stopping; raises Unreachable while there is none."""
        if self._work is None:
            raise Unreachable(f"no connection to {self.url}: {self.why_not or 'connecting'}")
        return self._work

    @property
    def silent(self) -> float:
        """For how many seconds the server has not answered what it is asked all the time; 0 while it answers."""
        quiet = time.monotonic() - self._heard
        return quiet if self.connected and quiet > SILENT_AFTER else 0.0

    @property
    def live(self) -> bool:
        """Whether what is shown is true now: connected, and the server answers."""
        return self.connected and not self.silent

    @property
    def station(self) -> Station:
        """The workstation that this person looks at."""
        return self.stations.get(self.station_name, Station(self.station_name))

    def may(self, what: str) -> bool:
        """Whether to offer something; at a workstation, the one that is looked at. The refusal is the server's."""
        return what in self.rights or f"{self.station_name}:{what}" in self.rights

    async def stop_motion(self, station: str, because: str) -> StopOutcome:
        """Ask for the protective stop of a workstation on the connection kept for it, and say what came of it."""
        began = time.monotonic()
        if self._watch is None:
            return StopOutcome(False, 0.0, self.why_not)
        try:
            async with asyncio.timeout(STOP_LIMIT):
                await self._watch.workstation(station).protective_stop(because)
        except TimeoutError:
            return StopOutcome(False, time.monotonic() - began, f"no answer within {STOP_LIMIT:g} s")
        except ClientError as error:
            return StopOutcome(False, time.monotonic() - began, str(error))
        self.look_again()
        return StopOutcome(True, time.monotonic() - began)

    def look_again(self) -> None:
        """Read arm and jobs at once, not at the next turn: something has just been asked for."""
        self._jobs_due = 0.0
        self._wake.set()

    async def _connect(self) -> None:
        clients = [SkillClient(self.url, self.user, self.password, folder=self.folder, timeout=WORK_TIMEOUT)]
        clients.append(SkillClient(self.url, self.user, self.password, folder=self.folder, timeout=WATCH_TIMEOUT))
        opened: list[SkillClient] = []
        try:
            for client in clients:
                opened.append(await client.__aenter__())
            self._work, self._watch = opened
            names = await self._watch.workstations()
            await self._read_rights(names)
            self.insecure = await self._watch.insecure()
            self.four_eyes = await self._watch.four_eyes()
            self.presets = await self._watch.presets()
        except BaseException as error:
            self._work = self._watch = None
            for client in opened:
                await client.__aexit__()
            if isinstance(error, OSError | TimeoutError):
                raise Unreachable(f"the connection to {self.url} broke while signing in") from error
            raise
        self.stations = {name: self.stations.get(name, Station(name)) for name in names}
        self.locked_here.clear()  # a lock ends with the connection that took it
        if self.station_name not in self.stations:
            self.station_name = names[0] if names else ""
        self._heard = time.monotonic()
        self.connected, self.why_not = True, ""

    async def _read_rights(self, stations: list[str]) -> None:
        assert self._watch is not None
        wanted = dict(RIGHTS)
        for name in stations:
            wanted |= {f"{name}:{what}": f"Machines/{name}/{method}" for what, method in STATION_RIGHTS.items()}
        told = await self._watch.session.may(*wanted.values())
        self.rights = frozenset(what for what, allowed in zip(wanted, told, strict=True) if allowed)

    async def _disconnect(self) -> None:
        work, watch = self._work, self._watch
        self._work = self._watch = None
        self.connected = False
        for client in (work, watch):
            if client is not None:
                with contextlib.suppress(ClientError, TimeoutError):
                    async with asyncio.timeout(WATCH_TIMEOUT):
                        await client.__aexit__()

    async def _keep_watching(self) -> None:
        while True:
            try:
                await self._watch_until_lost()
            except ClientError as error:
                self.why_not = str(error)
            except Exception as error:
                log.exception("watching for %s failed", self.user)
                self.why_not = f"fault in the panel: {error!r}"
            await self._disconnect()
            self.stations = {name: Station(name, None, one.jobs) for name, one in self.stations.items()}
            while not self.connected:
                await asyncio.sleep(RETRY_EVERY)
                try:
                    await self._connect()
                    self.times_recovered += 1
                    self.recovered_at = datetime.now(UTC)
                except ClientError as error:
                    self.why_not = str(error)
                    if isinstance(error, NotSignedIn) and error.wrong_user:
                        self.ended = str(error)
                        self.password = ""
                        return
                except Exception as error:
                    log.exception("connecting for %s failed", self.user)
                    self.why_not = f"fault in the panel: {error!r}"

    async def _watch_until_lost(self) -> None:
        watch = self._watch
        assert watch is not None
        async with watch.events() as told:
            listening = asyncio.create_task(self._listen(told))
            try:
                while True:
                    await self._look(watch)
                    self._wake.clear()
                    with contextlib.suppress(TimeoutError):
                        async with asyncio.timeout(WATCH_EVERY):
                            await self._wake.wait()
            finally:
                listening.cancel()
                await asyncio.gather(listening, return_exceptions=True)

    async def _listen(self, told: "asyncio.Queue[Event]") -> None:
        while True:
            event = await told.get()
            self.happenings.appendleft(Happening(next(self._numbers), datetime.now(UTC), event))
            if event.job_id:
                self.look_again()

    async def _look(self, watch: SkillClient) -> None:
        jobs_too = time.monotonic() >= self._jobs_due
        if jobs_too:
            self._jobs_due = time.monotonic() + JOBS_AT_LEAST_EVERY
            await self._read_rights(list(self.stations))
        for name in list(self.stations):
            station = watch.workstation(name)
            arm = await station.arm()
            self._heard = time.monotonic()
            known = self.stations[name]
            jobs = tuple(await station.jobs(limit=SHOWN_JOBS)) if jobs_too or known.active else known.jobs
            self.stations[name] = Station(name, arm, jobs, await station.lock_state(), await station.queue())
            self._heard = time.monotonic()
            await self._keep_lock(name)

    async def _keep_lock(self, name: str) -> None:
        """Renew a lock that this person has taken here, until it is given back; forget one that is gone."""
        lock = self.stations[name].lock
        due = name in self.locked_here and lock is not None and lock.seconds < RENEW_BELOW
        if due and not await self.client.workstation(name).renew_lock():
            self.locked_here.discard(name)

    def has_lock(self, name: str) -> bool:
        """Whether this person has an arm for themselves, taken here."""
        lock = self.stations[name].lock if name in self.stations else None
        return (
            name in self.locked_here
            and lock is not None
            and lock.locked
            and lock.user.casefold() == self.user.casefold()
        )

    async def take_lock(self, name: str) -> bool:
        """Have an arm for this person alone; return whether it is theirs now."""
        taken = await self.client.workstation(name).lock(f"panel of {self.user}")
        if taken:
            self.locked_here.add(name)
        self.look_again()
        return taken

    async def give_lock_back(self, name: str) -> None:
        """Let others have the arm again."""
        await self.client.workstation(name).unlock()
        self.locked_here.discard(name)
        self.look_again()

"""A plant's day through real clients against a real server: no motion begins that nobody wants any more.

The arm is one with a pendant (tests/fakes/pendant_arm.py); people, pendant, database and kill -9 do to it what
hypothesis likes. `tests/opcua_skill/test_motion_model.py` plays many more such days against the engine alone.
"""

import asyncio
import contextlib
import multiprocessing
import os
import sqlite3
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import replace
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import pytest
from deployed_skill import seed
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule
from motion_ledger import Beginning, Ledger

from library.store import SkillLibrary
from opcua_skill.client import APPLICATION_URI, ClientError, SkillClient
from opcua_skill.security import TrustList, ensure_client_certificate, hash_password
from tests.conftest import PASSWORD, free_port
from tests.fakes.pendant_server import serve_apart

STEPS = int(os.environ.get("OPCUA_SKILL_MOTION_SERVER_STEPS", "80"))
STEPS_A_DAY = 40
LIMIT = 180.0
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["tests.fakes.pendant_server"])
MOST_KILLS = 2
REFUSED = (ClientError, OSError, TimeoutError)


class Shop:
    """One server process after the other on one folder, and a client for each person."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp())
        self.url = f"opc.tcp://127.0.0.1:{free_port()}"
        mine = ensure_client_certificate(self.folder / "client", APPLICATION_URI)
        TrustList(self.folder / "data" / "certificates").trust(mine.certificate_file)
        self.database.write_bytes(seed())
        self.process: BaseProcess | None = None
        self.pendant: Any = None
        self.clients: list[SkillClient] = []
        self.read = 0

    async def add_users(self) -> None:
        async with await SkillLibrary.open(self.database) as library:
            for name, role in (("olga", "operator"), ("eve", "engineer")):
                await library.add_user(name, role, hash_password(PASSWORD))

    @property
    def database(self) -> Path:
        return self.folder / "data" / "skills.db"

    async def open(self) -> None:
        self.pendant, theirs = FORKS.Pipe()
        self.process = FORKS.Process(target=serve_apart, args=(self.folder, self.url, theirs))
        await asyncio.to_thread(self.process.start)
        theirs.close()
        assert (await asyncio.to_thread(self._heard)).startswith("listening on"), (self.folder / "log").read_text()
        for name in ("olga", "eve"):
            client = SkillClient(self.url, name, PASSWORD, folder=self.folder / "client")
            self.clients.append(await client.__aenter__())

    def _heard(self) -> str:
        try:
            return self.pendant.recv()
        except EOFError:
            return "it has ended"

    async def hand(self, word: str) -> None:
        """Do something at the arm itself."""
        self.pendant.send(word)
        assert await asyncio.to_thread(self._heard) == "done"

    async def kill(self) -> None:
        """Kill -9 the server; its clients leave a moment before, which saves them a long farewell to nobody."""
        assert self.process is not None
        for client in self.clients:
            with contextlib.suppress(*REFUSED, asyncio.CancelledError):
                await client.__aexit__(None, None, None)
        self.clients.clear()
        self.process.kill()
        await asyncio.to_thread(self.process.join)
        self.pendant.close()

    def news(self) -> list[Beginning]:
        """Return the motions that have begun since this was asked last."""
        file = self.folder / "began"
        lines = file.read_text().splitlines() if file.exists() else []
        fresh, self.read = lines[self.read :], len(lines)
        return [Beginning(int(at), kind, digest) for at, kind, digest in (line.split() for line in fresh)]


class Day(RuleBasedStateMachine):
    """A day at one workstation, each call answered before the next is made."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = asyncio.new_event_loop()
        self.ledger = Ledger()
        self.job_ids: list[str] = []
        self.recipes = 0
        self.kills = 0
        self.locked: sqlite3.Connection | None = None
        self.shop: Shop
        self.recipe: Any = None

    def run(self, work: Awaitable[Any]) -> Any:
        async def limited() -> Any:
            async with asyncio.timeout(LIMIT):
                return await work

        return self.loop.run_until_complete(limited())

    @property
    def olga(self) -> Any:
        return self.shop.clients[0].workstation("ws1")

    @initialize()
    def morning(self) -> None:
        self.shop = Shop()
        self.run(self.shop.add_users())
        self.run(self._opened())

    async def _opened(self) -> None:
        await self.shop.open()
        [self.recipe] = await self.shop.clients[1].recipes("glue")

    def ask(self, what: str, work: Callable[[], Awaitable[Any]], job_id: str = "") -> Any:
        """Ask for something; return the answer, or None where it was refused."""
        call = self.ledger.call(what, job_id)
        try:
            answer = self.run(work())
        except REFUSED as refused:
            call.done(good=False)
            return refused if what in {"abort", "stop", "hold"} else None
        call.done(good=True)
        return answer

    def arm(self) -> Any:
        return self.run(self.olga.arm())

    def until(self, what: str, true: Callable[[], Awaitable[bool]]) -> None:
        async def wait() -> None:
            while not await true():
                await asyncio.sleep(0.02)

        try:
            self.run(wait())
        except TimeoutError:
            raise AssertionError(f"within {LIMIT} s this did not come true: {what}") from None

    async def _held(self) -> bool:
        return (await self.olga.queue()).held

    def at_work(self, pick: int) -> str:
        """Return a job: the one under way, or one of the last."""
        for state in ("Running", "Paused"):
            if pick % 2 and self.locked is None:
                for job in self.run(self.olga.jobs(state, 1)):
                    return job.job_id
        return self.job_ids[-1 - pick % min(len(self.job_ids), 3)] if self.job_ids else "none"

    def unlock(self) -> None:
        if self.locked is not None:
            self.locked.rollback()
            self.locked.close()
            self.locked = None

    # People

    @rule()
    def execute(self) -> None:
        self.unlock()
        self.recipes += 1
        mine = replace(self.recipe, recipe_id=f"r{self.recipes}", standoff=0.001 + 1e-6 * self.recipes)
        self.run(self.shop.clients[1].put_recipe(mine))
        call = self.ledger.call("execute")
        try:
            call.job_id = self.run(self.olga.execute("glue", recipe_id=mine.recipe_id, mode="production")).job_id
        except REFUSED:
            call.done(good=False)
            return
        call.done(good=True)
        self.job_ids.append(call.job_id)
        self.ledger.jobs[self.run(self.olga.job(call.job_id)).plan_digest] = call.job_id

    @rule(pick=st.integers(0, 9))
    def pause(self, pick: int) -> None:
        self.unlock()
        job_id = self.at_work(pick)
        self.ask("pause", lambda: self.olga.pause(job_id), job_id)

    @rule(pick=st.integers(0, 9))
    def resume(self, pick: int) -> None:
        self.unlock()
        job_id = self.at_work(pick)
        self.ask("resume", lambda: self.olga.resume(job_id), job_id)

    @rule(pick=st.integers(0, 9), locked=st.booleans())
    def abort(self, pick: int, locked: bool) -> None:
        """Abort, while another program locks the database or not; what the arm runs is never refused."""
        job_id = self.at_work(pick)
        if locked:
            self.lock_the_database()
        mode = self.arm().mode
        answer = self.ask("abort", lambda: self.olga.abort(job_id), job_id)
        began = [one for one in self.shop_began() if one.kind == "run"]
        runs = bool(began) and self.ledger.jobs.get(began[-1].digest) == job_id
        if mode in {"running", "paused"} and runs and self.arm().mode in {"running", "paused"}:
            assert answer == "Stopping", f"an abort of what the arm runs was refused: {answer}"
        if answer == "Stopping":
            self.ledger.hold(f"abort of {job_id}")

    def shop_began(self) -> list[Beginning]:
        self.ledger.began += self.shop.news()
        return self.ledger.began

    @rule()
    def stop_motion(self) -> None:
        answer = self.ask("stop", lambda: self.olga.protective_stop("stop"))
        assert answer is None, f"a protective stop was refused: {answer}"

    @rule()
    def hold(self) -> None:
        assert self.ask("hold", lambda: self.olga.hold_queue("wait")) == "Held"

    @rule()
    def reset(self) -> None:
        self.unlock()
        self.ask("reset", lambda: self.olga.reset("looked"))

    @rule()
    def go_home(self) -> None:
        self.unlock()
        self.ask("go home", lambda: self.olga.go_home("looked"))

    @rule()
    def release(self) -> None:
        self.unlock()
        self.ask("release", lambda: self.olga.release_queue("looked"))

    @rule()
    def put_right(self) -> None:
        """Do what a person does who wants to go on, and ask for a run and one more."""
        self.unlock()
        self.run(self.shop.hand("mend"))
        self.reset()
        self.go_home()
        self.until("the arm comes to rest", self._at_rest)
        self.release()
        self.execute()
        self.execute()

    async def _at_rest(self) -> bool:
        return (await self.olga.arm()).mode not in {"running", "stopping"}

    # The arm's own side

    @rule()
    def pendant_pause(self) -> None:
        self.unlock()
        before = self.arm().mode
        self.run(self.shop.hand("pendant_pause"))
        if before == "running" and self.arm().mode == "paused" and self.run(self.olga.jobs("Running", 1)):
            self.until("a pause at the pendant holds the queue", self._held)
            self.ledger.hold("pendant pause")

    @rule(how=st.sampled_from(["pendant_resume", "pendant_stop", "fault", "mend"]))
    def by_hand(self, how: str) -> None:
        self.run(self.shop.hand(how))

    @rule()
    def lose(self) -> None:
        self.unlock()
        self.run(self.shop.hand("lose"))
        self.until("a lost arm holds the queue", self._held)
        self.ledger.hold("lost")

    @rule()
    def push(self) -> None:
        self.unlock()
        self.run(self.shop.hand("push"))
        if self.arm().mode == "idle":
            self.until("an arm that is pushed away holds the queue", self._held)
            self.ledger.hold("pushed")

    # Database and machine

    @rule()
    def lock_the_database(self) -> None:
        if self.locked is None:
            self.locked = sqlite3.connect(self.shop.database, isolation_level=None, timeout=20.0)
            self.locked.execute("BEGIN IMMEDIATE")

    @rule()
    def kill_the_server(self) -> None:
        self.unlock()
        self.kills += 1
        if self.kills > MOST_KILLS:
            return
        self.run(self.shop.kill())
        with contextlib.closing(sqlite3.connect(self.shop.database)) as other:
            left = other.execute("SELECT count(*) FROM jobs WHERE state NOT IN ('Completed', 'Failed', 'Aborted')")
            unfinished = left.fetchone()[0] > 0
        away = (self.shop.folder / "stands").exists() and (self.shop.folder / "stands").read_text() == "away"
        self.run(self.shop.open())
        if unfinished or away:
            queue = self.run(self.olga.queue())
            assert queue.held, "what was unfinished does not hold the queue"
            self.ledger.hold("start with something unfinished")

    # What always holds

    @invariant()
    def every_motion_was_wanted(self) -> None:
        if getattr(self, "shop", None):
            for began in self.shop_began()[-3:]:
                self.ledger.check(began)

    def teardown(self) -> None:
        if not getattr(self, "shop", None):
            return
        try:
            self.unlock()
            time.sleep(0.2)
            for began in self.shop_began():
                self.ledger.check(began)
        finally:
            self.run(self.shop.kill())
            self.loop.close()


TestDay = Day.TestCase
TestDay.settings = settings(
    max_examples=max(1, STEPS // STEPS_A_DAY),
    stateful_step_count=STEPS_A_DAY,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
TestDay.pytestmark = [pytest.mark.slow, pytest.mark.timeout(1800)]

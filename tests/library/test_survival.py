"""Killed while writing, or written to by two at once: what was acknowledged is there, what is there is whole."""

import asyncio
import os
import random
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from library.description import JobState
from library.records import AuditEntry, Failure
from library.store import SkillLibrary

WRITER = Path(__file__).with_name("writer.py")
KILLS = 20


class Writers:
    """Processes that store versions, forked on demand; what they say stands in ``told``, a list of words a line."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(WRITER)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "OMP_NUM_THREADS": "1"},
        )
        self.told: list[list[str]] = []

    def order(self, *words: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write("\t".join(map(str, words)) + "\n")
        self._process.stdin.flush()

    def hear(self, word: str = "") -> list[str]:
        """Return the next line that begins with ``word``; lines before it are kept as well."""
        assert self._process.stdout is not None
        while True:
            line = self._process.stdout.readline().split()
            assert line, "the writers died"
            self.told.append(line)
            if not word or line[0] == word:
                return line

    def close(self) -> None:
        self._process.communicate(timeout=60)
        assert self._process.returncode == 0


async def check_whole(library: SkillLibrary, name: str) -> int:
    """Return how many versions there are; each is complete, and its content has the digest it is listed with."""
    summaries = await library.versions(name)
    for summary in summaries[:30]:
        description = await library.description(name, summary.version)
        assert description.computed_digest() == summary.model_digest
        assert len(await library.recordings(name, summary.version)) == len(description.provenance.recordings) == 4
        assert len(await library.aligned(name, summary.version)) == 4
    assert [one.version for one in summaries] == list(range(len(summaries), 0, -1))
    if summaries:
        assert await library.recipe(await library.default_recipe_id(name))
    return len(summaries)


async def check_all_is_there(path: Path, told: list[list[str]]) -> None:
    """Check that everything acknowledged is there, and that no job is left as if somebody worked on it."""
    versions = {(int(line[2]), line[3]) for line in told if line[0] == "version"}
    async with await SkillLibrary.open(path) as library:
        assert versions <= {(one.version, one.model_digest) for one in await library.versions("glue")}
        for report in await library.interrupt_unfinished():
            assert (report.state, report.failure) == (JobState.FAILED, Failure.INTERRUPTED)
        assert await library.jobs("Running") == []
        completed = {one.job_id for one in await library.jobs("Completed", 1000)}
        assert {line[4] for line in told if line[0] == "version"} <= completed
        audited = {entry.entry_id for entry in await library.audit_trail(1000)}
        assert {int(line[2]) for line in told if line[0] == "audit"} <= audited


@pytest.mark.slow
async def test_a_killed_writer_leaves_nothing_half_and_loses_nothing_acknowledged(database_file: Path) -> None:
    dice = random.Random(20260301)
    writers = Writers()
    for _ in range(KILLS):
        writers.order("fork", database_file, "glue", 10_000)
        pid = int(writers.hear("pid")[1])
        for _ in range(dice.randrange(1, 4)):
            writers.hear()
        # At a random moment of the transactions that follow.
        await asyncio.sleep(dice.uniform(0.0, 0.05))
        os.kill(pid, signal.SIGKILL)
        writers.order("wait", pid)
        writers.hear("gone")
        await check_all_is_there(database_file, writers.told)
    writers.close()
    async with await SkillLibrary.open(database_file) as library:
        assert await check_whole(library, "glue") >= KILLS
        done = await library.jobs("Completed", 1000)
        versions = await library.versions("glue")
        assert sorted(one.skill_version for one in done) == sorted(one.version for one in versions)
    with closing(sqlite3.connect(database_file)) as plain:
        assert plain.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert plain.execute("PRAGMA foreign_key_check").fetchall() == []


@pytest.mark.slow
async def test_three_processes_write_at_once_and_none_loses(database_file: Path) -> None:
    writers = Writers()
    for name in ("glue", "glue", "weld"):
        writers.order("fork", database_file, name, 6)
    pids = [writers.hear("pid")[1] for _ in range(3)]
    for pid in pids:
        writers.order("wait", pid)
        assert writers.hear("gone") == ["gone", pid, "0"]
    writers.close()
    told = [int(line[2]) for line in writers.told if line[:2] == ["version", "glue"]]
    assert sorted(told) == list(range(1, 13))
    async with await SkillLibrary.open(database_file) as library:
        assert await check_whole(library, "glue") == 12
        assert await check_whole(library, "weld") == 6
        assert len(await library.audit_trail(1000)) == 18


async def test_many_tasks_of_one_process_write_at_once(library: SkillLibrary) -> None:
    ids = await asyncio.gather(*(library.audit(AuditEntry(action=str(number))) for number in range(60)))
    assert sorted(ids) == list(range(1, 61))

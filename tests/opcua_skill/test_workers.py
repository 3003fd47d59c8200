"""Computations run in their own processes: a dead, slow or cancelled one is a named failure, and the next one works."""

import asyncio
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from opcua_skill.jobs.process_pool import WorkerDied, Workers, WorkerTimeout, report_progress
from tests.processes import alive

LIMIT = 60.0


def double(value: int) -> int:
    return 2 * value


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def own_process() -> int:
    return os.getpid()


def wait_for_ever() -> None:
    threading.Event().wait()


def divide_by_zero() -> float:
    return 1 / 0


def half_way() -> None:
    report_progress(0.5)
    time.sleep(0.6)


@pytest.fixture
async def workers() -> AsyncIterator[Workers]:
    made = Workers(1, "test")
    yield made
    made.close()


async def test_an_answer_comes_from_another_process(workers: Workers) -> None:
    assert await workers.run("doubling", double, 21, seconds=LIMIT) == 42
    assert await workers.run("asking", own_process, seconds=LIMIT) != os.getpid()


async def test_exceptions_pass_through(workers: Workers) -> None:
    with pytest.raises(ZeroDivisionError):
        await workers.run("dividing", divide_by_zero, seconds=LIMIT)


async def test_a_dead_worker_is_named_and_replaced(workers: Workers) -> None:
    with pytest.raises(WorkerDied, match="while it was dying"):
        await workers.run("dying", die, seconds=LIMIT)
    assert await workers.run("doubling", double, 1, seconds=LIMIT) == 2


async def test_a_slow_computation_is_ended_and_the_next_one_works(workers: Workers) -> None:
    await workers.warm_up(own_process)
    with pytest.raises(WorkerTimeout):
        await workers.run("waiting", wait_for_ever, seconds=0.3)
    assert await workers.run("doubling", double, 1, seconds=LIMIT) == 2


async def test_cancelling_ends_the_computation(workers: Workers) -> None:
    before = await workers.run("asking", own_process, seconds=LIMIT)
    task = asyncio.create_task(workers.run("waiting", wait_for_ever, seconds=LIMIT))
    await asyncio.sleep(0.1)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert await workers.run("asking", own_process, seconds=LIMIT) != before
    async with asyncio.timeout(LIMIT):
        while alive(before):
            await asyncio.sleep(0.02)


async def test_progress_reaches_the_caller(workers: Workers) -> None:
    seen: list[float] = []
    await workers.run("going half way", half_way, seconds=LIMIT, on_progress=seen.append)
    assert 0.5 in seen


async def test_closing_leaves_no_process(workers: Workers) -> None:
    process = await workers.run("asking", own_process, seconds=LIMIT)
    workers.close()
    async with asyncio.timeout(LIMIT):
        while alive(process):
            await asyncio.sleep(0.02)


PARENT = """
import asyncio, os, time
from opcua_skill.jobs.process_pool import Workers
async def main():
    workers = Workers(1, "test")
    own, above = [await workers.run("asking", ask, seconds=60) for ask in (os.getpid, os.getppid)]
    print(own, above, flush=True)
    await asyncio.Event().wait()
asyncio.run(main())
"""


async def test_no_process_outlives_a_killed_parent() -> None:
    parent = await asyncio.create_subprocess_exec(sys.executable, "-c", PARENT, stdout=asyncio.subprocess.PIPE)
    assert parent.stdout is not None
    async with asyncio.timeout(LIMIT):
        processes = [int(text) for text in (await parent.stdout.readline()).split()]
        assert all(alive(process) for process in processes)
        parent.kill()
        await parent.wait()
        while any(alive(process) for process in processes):
            await asyncio.sleep(0.05)


async def test_a_long_temporary_folder_does_not_stop_learning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / ("long" * 20)
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    workers = Workers(1, "spawned")
    try:
        assert await workers.run("doubling", double, 21, seconds=LIMIT) == 42
    finally:
        workers.close()


def test_where_the_command_line_begins_imports_nothing() -> None:
    """Every worker runs that file anew, before its first computation."""
    asked = "import sys; before = set(sys.modules); import opcua_skill.cli; print(*set(sys.modules) - before)"
    done = subprocess.run([sys.executable, "-c", asked], check=True, capture_output=True, text=True, timeout=LIMIT)
    assert set(done.stdout.split()) == {"opcua_skill", "opcua_skill.cli"}


PREPARED = """
import asyncio, gc, os, sys
from opcua_skill.jobs import process_pool

def seen():
    links = [f"/proc/self/fd/{one}" for one in os.listdir("/proc/self/fd")]
    files = [os.readlink(one) for one in links if os.path.exists(one)]
    return "wave" in sys.modules, gc.isenabled(), __file__ in files

async def main():
    pool = process_pool.Workers(1, "test")
    print(await pool.run("looking", seen, seconds=60.0), flush=True)
    if sys.argv[1:] == ["wait"]:
        await asyncio.sleep(3600)
    pool.close()

if __name__ == "__main__":
    import wave  # nothing of ours does: a worker that has it was forked from here
    gc.disable()
    own = open(__file__)
    process_pool.prepare()
    asyncio.run(main())
"""
AS_PREPARED = "(True, True, False)"


def prepared(folder: Path, *words: str) -> "subprocess.Popen[str]":
    script = folder / "prepared.py"
    script.write_text(PREPARED, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.Popen([sys.executable, str(script), *words], env=environment, stdout=subprocess.PIPE, text=True)


def test_workers_of_a_prepared_process_have_what_it_had_imported(tmp_path: Path) -> None:
    process = prepared(tmp_path)
    told, _ = process.communicate(timeout=LIMIT)
    assert (process.returncode, told.strip()) == (0, AS_PREPARED)


def test_nobody_is_left_of_a_prepared_process_that_is_killed(tmp_path: Path) -> None:
    process = prepared(tmp_path, "wait")
    assert process.stdout is not None
    assert process.stdout.readline().strip() == AS_PREPARED
    process.kill()
    told, _ = process.communicate(timeout=LIMIT)  # ends when the last one who has this pipe has gone
    assert told == ""

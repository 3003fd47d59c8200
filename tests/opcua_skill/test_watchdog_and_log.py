"""A loop that is held is noticed with the place; a log stays within its budget; a budget counts what does not fit."""

import asyncio
import errno
import logging
import time

import pytest

from library.records import AuditEntry
from opcua_skill.configuration.logs import BYTES_AT_ONCE, LONGEST_LINE, LogBudget, _said_briefly
from opcua_skill.server.auditing import AuditWriter
from opcua_skill.stack.diagnostics.watchdog import Watchdog
from opcua_skill.stack.transport.budgets import Budget


def hold_the_loop(seconds: float) -> None:
    until = time.thread_time() + seconds
    while time.thread_time() < until:
        pass


async def test_a_held_loop_is_noticed_with_the_place_and_a_busy_one_is_not() -> None:
    watchdog = Watchdog()
    watchdog.start()
    for _ in range(20):
        await asyncio.sleep(0.005)
    hold_the_loop(0.2)
    async with asyncio.timeout(20):
        while not watchdog.holds:
            await asyncio.sleep(0.01)
    assert watchdog.longest > 0.1
    assert any("hold_the_loop" in hold.where for hold in watchdog.latest)
    await watchdog.stop()


def test_a_budget_lets_so_many_pass_and_counts_the_others() -> None:
    now = [0.0]
    budget = Budget(3, 1.0, clock=lambda: now[0])
    assert [budget.admits("a") for _ in range(5)] == [True, True, True, False, False]
    assert budget.admits("b")
    assert budget.take_beyond() == {"a": 2}
    assert budget.take_beyond() == {}
    now[0] = 2.0
    assert [budget.admits("a") for _ in range(3)] == [True, True, False]


def line(text: str, *given: object, fault: BaseException | None = None) -> logging.LogRecord:
    exc_info = (type(fault), fault, fault.__traceback__) if fault is not None else None
    return logging.LogRecord("x", logging.ERROR, "here", 1, text, given, exc_info)


def test_a_log_line_is_cut_and_very_many_are_dropped_and_counted() -> None:
    budget = LogBudget()
    long = line("%s", "x" * 1_000_000)
    assert budget.filter(long)
    assert len(long.getMessage()) < LONGEST_LINE + 100
    passed = sum(budget.filter(line("x" * 1_000)) for _ in range(5_000))
    assert passed * 1_000 < BYTES_AT_ONCE * 1.1
    assert budget.take_dropped() == 5_000 - passed
    assert budget.take_dropped() == 0


def test_a_line_that_does_not_fit_its_arguments_is_still_one() -> None:
    assert LogBudget().filter(line("%d %d", "not a number"))


async def test_no_room_for_connections_is_said_once_and_without_a_traceback(caplog: pytest.LogCaptureFixture) -> None:
    loop = asyncio.get_running_loop()
    for _ in range(100):
        _said_briefly(loop, {"message": "accept failed", "exception": OSError(errno.EMFILE, "Too many open files")})
    assert len(caplog.records) == 1
    assert caplog.records[0].exc_info is None


class Unwritable:
    """A library whose audit trail cannot be written until it is told to."""

    def __init__(self) -> None:
        self.works = False
        self.written: list[AuditEntry] = []

    async def audit(self, entry: AuditEntry) -> int:
        if not self.works:
            raise OSError("the disk is full")
        self.written.append(entry)
        return len(self.written)


async def test_what_cannot_be_recorded_is_kept_in_order_and_written_later() -> None:
    library, told = Unwritable(), []
    writer = AuditWriter(library, told.append)  # type: ignore[arg-type]
    writer.start()
    adding = [asyncio.create_task(writer.add(AuditEntry(action=str(number)))) for number in range(3)]
    await asyncio.gather(*adding)
    assert (writer.behind, library.written, told[-1]) == (3, [], False)
    library.works = True
    async with asyncio.timeout(20):
        while writer.behind:
            await asyncio.sleep(0.01)
    assert [entry.action for entry in library.written] == ["0", "1", "2"]
    assert told[-1]
    await writer.stop()

"""The log has a budget: lines are cut, of very many only so many are written, and the others are counted."""

import asyncio
import errno
import logging
from typing import Any

from opcua_skill.stack.transport.budgets import Budget

LONGEST_LINE, LONGEST_TRACEBACK = 2_000, 8_000
BYTES_AT_ONCE, BYTES_A_SECOND = 2_000_000.0, 4_000.0

_log = logging.getLogger(__name__)


class LogBudget(logging.Filter):
    """Cuts what is long and drops what is beyond two megabytes at once and four kilobytes a second, on one handler."""

    def __init__(self) -> None:
        super().__init__()
        self._budget = Budget(BYTES_AT_ONCE, BYTES_A_SECOND)

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is written, cut to a length that somebody reads."""
        try:
            line = record.getMessage()
        except Exception as error:
            line = f"a line that cannot be written: {error}"
        if len(line) > LONGEST_LINE:
            line = f"{line[:LONGEST_LINE]}… ({len(line)} characters)"
        record.msg, record.args = line, None
        if record.exc_info and not record.exc_text:
            trace = logging.Formatter().formatException(record.exc_info)
            cut = len(trace) > LONGEST_TRACEBACK
            record.exc_text = (
                f"{trace[: LONGEST_TRACEBACK // 2]}\n…\n{trace[-LONGEST_TRACEBACK // 2 :]}" if cut else trace
            )
        size = 100 + len(line) + len(record.exc_text or "")
        return record.name == __name__ or self._budget.admits("log", float(size))

    def take_dropped(self) -> int:
        """Return how many lines were dropped since this was asked last."""
        return sum(self._budget.take_beyond().values())


class Logs:
    """The budget of every handler of this process, for as long as a server runs in it."""

    def __init__(self) -> None:
        self._filters: list[tuple[logging.Handler, LogBudget]] = []

    def start(self) -> None:
        """Put every handler on its budget, and say what the loop could not do in one line each."""
        for handler in logging.getLogger().handlers:
            budget = LogBudget()
            handler.addFilter(budget)
            self._filters.append((handler, budget))
        asyncio.get_running_loop().set_exception_handler(_said_briefly)

    def stop(self) -> None:
        """Take the budgets away again."""
        for handler, budget in self._filters:
            handler.removeFilter(budget)
        self._filters.clear()

    def take_dropped(self) -> int:
        """Return how many lines were dropped since this was asked last, and say so in the log."""
        dropped = max((budget.take_dropped() for _, budget in self._filters), default=0)
        if dropped:
            _log.warning("%d lines were not logged: more came than the log has room for", dropped)
        return dropped


_no_room = Budget(1.0, 0.2)


def _said_briefly(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Say that there is no room for another connection in one line: the loop tries again by itself."""
    error = context.get("exception")
    if isinstance(error, OSError) and error.errno in {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}:
        if _no_room.admits("connections"):
            _log.error(
                "no connection can be taken in, %d times before: %s",
                _no_room.take_beyond().get("connections", 0),
                error.strerror,
            )
        return
    loop.default_exception_handler(context)

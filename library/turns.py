"""A transaction's turn: how long its caller waits for it, and the moment from which it cannot be given up."""

import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import Enum, auto
from typing import Any

import sqlalchemy as sql

from library.errors import LibraryUnusable, Trouble

Work = Callable[[sql.Connection], Any]
BUSY_SECONDS = 30.0
"""s that a transaction waits for its turn unless ``waiting_at_most`` says otherwise: longer than any of ours takes."""
READERS = 6
"""Transactions that read at one time: more would only take the interpreter from each other."""
REMEDY_LOCKED = "another program holds it for long: close that program, then try again"
_patience: ContextVar[float] = ContextVar("library_patience", default=BUSY_SECONDS)


@contextmanager
def waiting_at_most(seconds: float) -> Generator[None]:
    """Have transactions that are asked for within the block wait no longer for their turn; then they are void."""
    token = _patience.set(seconds)
    try:
        yield
    finally:
        _patience.reset(token)


class _Stage(Enum):
    WAITING = auto()
    VOID = auto()
    COMMITTING = auto()


class Void(Exception):
    """Nobody waits for the transaction any more: nothing of it may stay."""


class Turn:
    """One transaction as its caller and its thread see it: either void, or committed, never both."""

    def __init__(self) -> None:
        self._stage = _Stage.WAITING
        self._guard = threading.Lock()
        self.until = time.monotonic() + _patience.get()

    def void(self) -> bool:
        """Give the transaction up; return whether that was possible: not once it is being committed."""
        with self._guard:
            if self._stage is _Stage.WAITING:
                self._stage = _Stage.VOID
            return self._stage is _Stage.VOID

    def check(self) -> None:
        """Raise Void if it was given up."""
        if self._stage is _Stage.VOID:
            raise Void

    def commit(self) -> None:
        """Begin to commit: from here on it cannot be given up."""
        with self._guard:
            self.check()
            self._stage = _Stage.COMMITTING


def busy(where: str) -> LibraryUnusable:
    """Return what a caller is told whose turn did not come."""
    return LibraryUnusable(where, "database is locked", REMEDY_LOCKED, Trouble.LOCKED)

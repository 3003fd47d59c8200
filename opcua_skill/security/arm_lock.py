"""The DI Lock (OPC 10000-100, section 7): one client at a time may command an arm. Lost with its session."""

import time
from collections.abc import Callable
from dataclasses import dataclass

OK, ALREADY_LOCKED, NOT_LOCKED, INVALID = 0, -1, -1, -2


class LockedByAnother(Exception):
    """Another client holds the lock of this arm."""

    def __init__(self, arm: str, user: str, client: str) -> None:
        super().__init__(f"the arm of {arm} is locked by {user} ({client}): ask them to release it")


@dataclass(frozen=True, slots=True)
class Holder:
    """Who holds a lock, and until when (monotonic seconds)."""

    session_id: str
    user: str
    client: str
    until: float


class ArmLock:
    """The lock of one arm. ``seconds`` is how long it lasts without being renewed."""

    def __init__(self, arm: str, seconds: float = 600.0, clock: Callable[[], float] = time.monotonic) -> None:
        self._arm = arm
        self.seconds = seconds
        self._clock = clock
        self._holder: Holder | None = None

    @property
    def holder(self) -> Holder | None:
        """Who holds the lock now; a lock that was not renewed in time is nobody's."""
        if self._holder is not None and self._clock() >= self._holder.until:
            self._holder = None
        return self._holder

    @property
    def remaining_seconds(self) -> float:
        """How long the lock still lasts; 0 when nobody holds it."""
        return self.holder.until - self._clock() if self.holder else 0.0

    def take(self, session_id: str, user: str, client: str) -> int:
        """InitLock: 0, or -1 when somebody (also oneself) holds it already."""
        if self.holder is not None:
            return ALREADY_LOCKED
        self._holder = Holder(session_id, user, client, self._clock() + self.seconds)
        return OK

    def renew(self, session_id: str) -> int:
        """RenewLock: 0, or -1 when the caller does not hold it."""
        if self.holder is None or self.holder.session_id != session_id:
            return NOT_LOCKED
        self._holder = Holder(session_id, self.holder.user, self.holder.client, self._clock() + self.seconds)
        return OK

    def give_back(self, session_id: str) -> int:
        """ExitLock: 0, or -1 when the caller does not hold it."""
        if self.holder is None or self.holder.session_id != session_id:
            return NOT_LOCKED
        self._holder = None
        return OK

    def break_lock(self) -> int:
        """BreakLock: 0, or -1 when nobody holds it. Whoever calls this needs the right to."""
        if self.holder is None:
            return NOT_LOCKED
        self._holder = None
        return OK

    def session_closed(self, session_id: str) -> bool:
        """Give the lock back if that session held it; return whether it did."""
        return self.give_back(session_id) == OK

    def check(self, session_id: str) -> None:
        """Raise LockedByAnother unless the arm is free or the caller's."""
        holder = self.holder
        if holder is not None and holder.session_id != session_id:
            raise LockedByAnother(self._arm, holder.user, holder.client)

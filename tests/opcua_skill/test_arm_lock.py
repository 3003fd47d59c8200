"""The DI lock: one client at a time, lost with its session or when it is not renewed."""

import pytest

from opcua_skill.security.arm_lock import ArmLock, LockedByAnother


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_only_the_holder_renews_and_gives_back() -> None:
    lock = ArmLock("ws1")
    assert lock.take("session-1", "mes", "line 1") == 0
    assert lock.take("session-2", "panel", "screen") == -1
    assert lock.renew("session-2") == -1
    assert lock.give_back("session-2") == -1
    assert lock.renew("session-1") == 0
    assert lock.give_back("session-1") == 0
    assert lock.holder is None


def test_others_are_refused_while_it_is_held_and_told_by_whom() -> None:
    lock = ArmLock("ws1")
    lock.check("session-2")
    lock.take("session-1", "mes", "line 1")
    lock.check("session-1")
    with pytest.raises(LockedByAnother, match="ws1 is locked by mes"):
        lock.check("session-2")


def test_it_ends_with_its_session() -> None:
    lock = ArmLock("ws1")
    lock.take("session-1", "mes", "line 1")
    assert not lock.session_closed("session-2")
    assert lock.session_closed("session-1")
    lock.check("session-2")


def test_it_ends_when_it_is_not_renewed_in_time() -> None:
    clock = Clock()
    lock = ArmLock("ws1", seconds=10.0, clock=clock)
    lock.take("session-1", "mes", "line 1")
    clock.now = 9.0
    assert lock.remaining_seconds == pytest.approx(1.0)
    lock.renew("session-1")
    clock.now = 18.0
    with pytest.raises(LockedByAnother):
        lock.check("session-2")
    clock.now = 19.5
    lock.check("session-2")
    assert lock.renew("session-1") == -1


def test_breaking_frees_it_for_the_next() -> None:
    lock = ArmLock("ws1")
    assert lock.break_lock() == -1
    lock.take("session-1", "mes", "line 1")
    assert lock.break_lock() == 0
    assert lock.take("session-2", "panel", "screen") == 0

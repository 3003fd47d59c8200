"""Passwords, user certificates and lock-out, against a user store in memory."""

import asyncio
import time
from dataclasses import dataclass, field

import pytest
from argon2 import PasswordHasher

from opcua_skill.security import Authenticator, LockOut, hash_password
from opcua_skill.security.access import Identity, Peer, Role

PASSWORD = "correct horse battery"
HERE, THERE = Peer("10.0.0.1", b"certificate of one station"), Peer("10.0.0.2", b"certificate of another")


@dataclass(frozen=True)
class Row:
    name: str
    role: str
    password_hash: str = ""
    certificate: bytes = b""


@dataclass
class Users:
    rows: list[Row] = field(default_factory=lambda: [Row("anna", "engineer", hash_password(PASSWORD), b"DER of anna")])

    async def users(self) -> list[Row]:
        return self.rows

    async def set_password_hash(self, name: str, password_hash: str) -> None:
        self.rows = [Row(r.name, r.role, password_hash, r.certificate) for r in self.rows]


async def test_a_right_password_names_the_user():
    assert await Authenticator(Users()).by_password("anna", PASSWORD, HERE) == Identity("anna", Role.ENGINEER)


@pytest.mark.parametrize(
    ("name", "password"), [("anna", "wrong"), ("anna", ""), ("bob", PASSWORD), ("", ""), ("anna", "x" * 10**6)]
)
async def test_a_wrong_name_or_password_names_nobody(name: str, password: str):
    assert await Authenticator(Users()).by_password(name, password, HERE) is None


async def test_a_user_without_a_password_cannot_sign_in_with_any():
    users = Users([Row("robot", "operator", "", b"DER of robot")])
    for password in ("", "no user has this password"):
        assert await Authenticator(users).by_password("robot", password, HERE) is None


async def test_a_user_certificate_names_its_user_and_an_empty_one_nobody():
    users = Users([Row("anna", "engineer", "", b"DER of anna"), Row("bob", "admin", hash_password(PASSWORD))])
    authenticator = Authenticator(users)
    assert await authenticator.by_certificate(b"DER of anna", HERE) == Identity("anna", Role.ENGINEER)
    assert await authenticator.by_certificate(b"DER of eve", HERE) is None
    assert await authenticator.by_certificate(b"", HERE) is None


async def test_a_name_is_locked_for_the_station_that_guesses_and_for_no_other():
    authenticator = Authenticator(Users(), LockOut(failures=3, seconds=60))
    for _ in range(3):
        await authenticator.by_password("anna", "guess", HERE)
    assert await authenticator.by_password("anna", PASSWORD, HERE) is None
    assert await authenticator.by_password("anna", PASSWORD, THERE) is not None


async def test_a_lock_ends_by_itself():
    authenticator = Authenticator(Users(), LockOut(failures=1, seconds=0.2))
    await authenticator.by_password("anna", "guess", HERE)
    assert await authenticator.by_password("anna", PASSWORD, HERE) is None
    deadline = time.monotonic() + 10
    while await authenticator.by_password("anna", PASSWORD, HERE) is None:
        assert time.monotonic() < deadline


async def test_a_success_forgets_earlier_failures():
    authenticator = Authenticator(Users(), LockOut(failures=2, seconds=60))
    for _ in range(3):
        await authenticator.by_password("anna", "guess", HERE)
        if _ == 0:
            assert await authenticator.by_password("anna", PASSWORD, HERE) is not None
    assert await authenticator.by_password("anna", PASSWORD, HERE) is None


async def test_hashing_does_not_hold_up_the_event_loop():
    authenticator, gaps = Authenticator(Users()), []

    async def watch() -> None:
        while True:
            begun = time.perf_counter()
            await asyncio.sleep(0)
            gaps.append(time.perf_counter() - begun)

    watching = asyncio.create_task(watch())
    await asyncio.gather(*(authenticator.by_password("anna", PASSWORD, HERE) for _ in range(5)))
    watching.cancel()
    assert len(gaps) > 50


async def test_an_older_weaker_hash_is_replaced_at_sign_in():
    weak = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1).hash(PASSWORD)
    users = Users([Row("anna", "engineer", weak)])
    authenticator = Authenticator(users)
    assert await authenticator.by_password("anna", PASSWORD, HERE) is not None
    assert users.rows[0].password_hash != weak
    assert await authenticator.by_password("anna", PASSWORD, HERE) is not None


@pytest.mark.parametrize("password", ["", "short", "x" * 2000])
def test_a_password_that_is_too_short_or_too_long_is_refused(password: str):
    with pytest.raises(ValueError, match="password"):
        hash_password(password)

"""Who may sign in."""

from typing import Any

import sqlalchemy as sql

from library.errors import AlreadyExists, NotFound
from library.names import named
from library.records import User
from library.tables import users
from library.values import now


def add(connection: sql.Connection, name: str, role: str, password_hash: str, certificate: bytes, actor: str) -> User:
    """Store a new user."""
    if (same := named([one.name for one in everyone(connection)], name)) is not None:
        raise AlreadyExists("user", same, "remove that one first or choose another name")
    user = User(name, role, password_hash, certificate, now(), actor)
    connection.execute(
        users.insert().values(
            name=name,
            role=role,
            password_hash=password_hash,
            certificate=certificate,
            created_at=user.created_at,
            created_by=actor,
        )
    )
    return user


def everyone(connection: sql.Connection) -> list[User]:
    """Return all users in the order of their names."""
    return [_user(row) for row in connection.execute(sql.select(users).order_by(users.c.name))]


def read(connection: sql.Connection, name: str) -> User:
    """Return a user, however the name is typed; of two who differ in that alone, the one written exactly so."""
    found = named([one.name for one in everyone(connection)], name)
    if found is None:
        raise NotFound("user", name)
    return _user(connection.execute(sql.select(users).where(users.c.name == found)).one())


def set_password_hash(connection: sql.Connection, name: str, password_hash: str) -> None:
    """Give a user another password."""
    name = read(connection, name).name
    connection.execute(users.update().where(users.c.name == name).values(password_hash=password_hash))


def set_role(connection: sql.Connection, name: str, role: str) -> None:
    """Give a user another role."""
    name = read(connection, name).name
    connection.execute(users.update().where(users.c.name == name).values(role=role))


def remove(connection: sql.Connection, name: str) -> None:
    """Remove a user; what the user did stays in the records."""
    name = read(connection, name).name
    connection.execute(users.delete().where(users.c.name == name))


def _user(row: Any) -> User:
    return User(row.name, row.role, row.password_hash, bytes(row.certificate), row.created_at, row.created_by)

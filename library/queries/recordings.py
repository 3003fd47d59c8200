"""Recordings: stored once however often they are used, and never changed."""

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sql

from library.queries import versions
from library.queries.encoding import PackedRecording
from library.tables import recordings, version_recordings


def keep(connection: sql.Connection, packed: Sequence[PackedRecording], name: str, version: int) -> None:
    """Store the recordings that are not there yet, and note which ones the version was learned from, in order."""
    digests = {recording.digest for recording in packed}
    known = set(connection.scalars(sql.select(recordings.c.digest).where(recordings.c.digest.in_(digests))))
    for recording in packed:
        if recording.digest not in known:
            known.add(recording.digest)
            connection.execute(recordings.insert().values(recording.row))
    for position, recording in enumerate(packed):
        connection.execute(
            version_recordings.insert().values(
                skill_name=name, version=version, position=position, digest=recording.digest
            )
        )


def of_version(connection: sql.Connection, name: str, version: int) -> Sequence[sql.Row[Any]]:
    """Return the rows of the recordings a version was learned from, in the order they were given."""
    version = versions.number(connection, name, version)
    used = version_recordings.c
    query = sql.select(recordings).join(version_recordings, used.digest == recordings.c.digest)
    return connection.execute(
        query.where(used.skill_name == name, used.version == version).order_by(used.position)
    ).all()

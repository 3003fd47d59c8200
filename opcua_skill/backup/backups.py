"""What a backup is: a folder with a copy of the library, the files of the data folder and a manifest that names them.

It is made beside a running server, under a hidden name; it gets its own once everything in it has been read back.
"""

import contextlib
import errno
import fcntl
import hashlib
import os
import secrets
import shutil
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version as installed_version
from pathlib import Path, PurePosixPath
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from library.errors import LibraryUnusable
from library.private_files import make_private
from library.snapshots import check_copy, copy_library
from models.errors import SkillError
from opcua_skill.configuration.data_lock import database_file, lock_files
from opcua_skill.configuration.settings import Settings

MANIFEST, LIBRARY, FILES = "manifest.json", "skills.db", "data"
MARGIN = 1_000_000
"""bytes that a disk has to have free beside those of a backup."""


class BackupFault(SkillError):
    """A backup that cannot be made, or one that cannot be restored: one sentence. What was there is as it was."""


class BackedUpFile(BaseModel):
    """One file of a backup: its place in it, size in bytes, SHA-256 in hex, and the mode it had, as chmod writes it."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    path: str
    size: int = Field(ge=0)
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")
    mode: str = Field(pattern=r"^[0-7]{3}$")

    @field_validator("path")
    @classmethod
    def _path_stays_inside(cls, path: str) -> str:
        parts = PurePosixPath(path).parts
        if str(PurePosixPath(*parts)) != path or ".." in parts or parts[0] not in (LIBRARY, FILES) or "\0" in path:
            raise ValueError("leads to no place in a backup")
        return path


class Manifest(BaseModel):
    """What is in a backup. ``revision`` is that of the library's tables; ``made_at`` is in UTC."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["opcua-skill backup 1"] = "opcua-skill backup 1"
    program: str
    host: str
    data: str
    made_at: datetime
    revision: str
    files: tuple[BackedUpFile, ...]


def make_backup(settings: Settings, target: Path) -> Manifest:
    """Write a backup of a data folder into ``target``, a new folder or an empty one, and return what is in it.

    Raises BackupFault, LibraryUnusable or OSError; then ``target`` is as it was.
    """
    data, database = settings.data.resolve(), database_file(settings)
    if database is None:
        raise BackupFault("the library is on a database server: back it up with its tools (pg_dump, pg_basebackup)")
    if not data.is_dir() or not database.is_file():
        raise BackupFault(f"there is no library {database}: check --data")
    target = target.absolute()
    _check_target(target, data)
    found = data_files(data, database, settings)
    _check_room(target, sum(size for _, size in found) + database.stat().st_size)
    with _scratch(target) as scratch, _one_sentence(target):
        copy_library(database, scratch / LIBRARY)
        (scratch / LIBRARY).chmod(0o600)
        described = [_copied(file, scratch, f"{FILES}/{file.relative_to(data).as_posix()}") for file, _ in found]
        revision = check_copy(scratch / LIBRARY)
        size = (scratch / LIBRARY).stat().st_size
        library = BackedUpFile(path=LIBRARY, size=size, sha256=_digest(scratch / LIBRARY), mode="600")
        manifest = Manifest(
            program=installed_version("opcua-skill"),
            host=socket.gethostname(),
            data=str(data),
            made_at=datetime.now(UTC),
            revision=revision,
            files=(library, *(one for one in described if one is not None)),
        )
        written = scratch / MANIFEST
        written.write_text(manifest.model_dump_json(indent=1), encoding="utf-8")
        written.chmod(0o600)
        for one in (written, *_folders_of(scratch)):
            _sync(one)
        read_backup(scratch)
        scratch.rename(target)
        _sync(target.parent)
    return manifest


def read_backup(folder: Path) -> Manifest:
    """Return what is in a backup after checking every byte of it; raises BackupFault or LibraryUnusable."""
    manifest = _manifest(folder)
    there = {file.relative_to(folder).as_posix() for file in _files_of(folder)} - {MANIFEST}
    named = {one.path for one in manifest.files}
    if len(named) != len(manifest.files) or LIBRARY not in named:
        raise BackupFault(f"{folder / MANIFEST} is damaged: use another backup")
    if missing := sorted(named - there):
        raise BackupFault(f"{folder / missing[0]} is missing: use another backup, this one is not whole")
    if foreign := sorted(there - named):
        raise BackupFault(f"{folder / foreign[0]} does not belong to this backup: move it away if you know what it is")
    for one in manifest.files:
        file = folder / one.path
        if file.is_symlink() or file.stat().st_size != one.size or _digest(file) != one.sha256:
            raise BackupFault(f"{file} is damaged, it is not what was backed up: use another backup")
    check_copy(folder / LIBRARY)
    return manifest


def data_files(data: Path, database: Path, settings: Settings) -> list[tuple[Path, int]]:
    """Return the files of a data folder that have to come back, with their sizes in bytes.

    All but the library itself, locks, and what is hidden: that is unfinished.
    """
    apart = {database, *(database.with_name(f"{database.name}{end}") for end in ("-wal", "-shm", "-journal"))}
    apart |= set(lock_files(settings))
    found: list[tuple[Path, int]] = []
    for file in _files_of(data, hidden=False):
        with contextlib.suppress(FileNotFoundError):  # gone since it was listed: a rejected certificate, a trace
            status = file.stat()
            if file not in apart and stat.S_ISREG(status.st_mode):
                found.append((file, status.st_size))
    return found


def _manifest(folder: Path) -> Manifest:
    file = folder / MANIFEST
    if not folder.is_dir() or not file.is_file():
        raise BackupFault(f"{folder} is no backup: it has no {MANIFEST}")
    try:
        return Manifest.model_validate_json(file.read_bytes())
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "it"
        if first["loc"] == ("format",):
            raise BackupFault(f"{file} was written by another version of this program: install that one") from None
        raise BackupFault(f"{file} is damaged, {where}: {first['msg']}: use another backup") from None


def _check_target(target: Path, data: Path) -> None:
    if target.resolve().is_relative_to(data):
        raise BackupFault(f"{target} lies in the data folder {data}: name a folder elsewhere, best on another disk")
    if target.is_symlink() or (target.exists() and not target.is_dir()):
        raise BackupFault(f"{target} is there and no folder: name another one")
    if target.is_dir() and (there := next(target.iterdir(), None)) is not None:
        raise BackupFault(f"{target} holds {there.name} already: name a new folder, or an empty one")
    if target.is_mount():
        raise BackupFault(f"{target} is where a disk is mounted: name a folder in it")


def _check_room(target: Path, needed: int) -> None:
    above = next(folder for folder in target.parents if folder.exists())
    free = shutil.disk_usage(above).free
    if free < needed + MARGIN:
        raise BackupFault(
            f"the disk of {target} has {free / 1e6:.0f} MB free, the backup needs {(needed + MARGIN) / 1e6:.0f}:"
            " nothing was written"
        )


@contextmanager
def _scratch(target: Path) -> Iterator[Path]:
    """Make a hidden folder beside ``target`` that is gone afterwards unless it was renamed, as are those left there."""
    make_private(target.parent)
    for left in target.parent.glob(f".{target.name}.*.part"):
        with contextlib.suppress(BlockingIOError), _locked(left):
            shutil.rmtree(left)
    scratch = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    scratch.mkdir(mode=0o700)
    with _locked(scratch):
        try:
            yield scratch
        finally:
            shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Hold the kernel's lock on a folder; raises BlockingIOError where another process does."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _one_sentence(target: Path) -> Iterator[None]:
    """Say of a disk that is full, or of a library that cannot be read, that there is no backup."""
    try:
        yield
    except OSError as error:
        full = error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
        reason = "its disk is full" if full else error.strerror or str(error)
        raise BackupFault(f"{target} was not written, {reason}: free space or name another folder") from error
    except LibraryUnusable as error:
        raise BackupFault(f"{target} was not written: {error}") from error


def _copied(source: Path, scratch: Path, path: str) -> BackedUpFile | None:
    """Copy a file to its place, for this user alone, and describe what was read; None if it has gone meanwhile."""
    target = scratch / path
    digest, size = hashlib.sha256(), 0
    try:
        read = source.open("rb")
    except FileNotFoundError:
        return None
    make_private(target.parent)
    with read, os.fdopen(os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as written:
        while piece := read.read(1 << 20):
            digest.update(piece)
            size += written.write(piece)
        written.flush()
        os.fsync(written.fileno())
        mode = stat.S_IMODE(os.fstat(read.fileno()).st_mode) & 0o777
    return BackedUpFile(path=path, size=size, sha256=digest.hexdigest(), mode=f"{mode:03o}")


def _files_of(folder: Path, *, hidden: bool = True) -> list[Path]:
    """Return what is below a folder and no folder, in order; links to folders are followed once."""
    found: list[Path] = []
    seen: set[str] = set()
    for at, folders, files in os.walk(folder, followlinks=not hidden):
        seen.add(os.path.realpath(at))
        kept = [name for name in folders if hidden or not name.startswith(".")]
        folders[:] = [name for name in kept if os.path.realpath(Path(at) / name) not in seen]
        found += [Path(at) / name for name in files if hidden or not name.startswith(".")]
        if hidden:
            found += [Path(at) / name for name in folders if (Path(at) / name).is_symlink()]
    return sorted(found)


def _folders_of(folder: Path) -> list[Path]:
    return [Path(at) for at, _, _ in os.walk(folder)]


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

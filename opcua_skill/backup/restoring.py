"""A backup put back: into a data folder that holds nothing yet, after every byte was checked, with the modes it had."""

import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from library.private_files import OTHERS, make_private
from library.records import AuditEntry
from library.store import SkillLibrary
from opcua_skill.backup.backups import FILES, LIBRARY, BackupFault, Manifest, read_backup
from opcua_skill.configuration.data_lock import DataLock, database_file, holder, lock_files
from opcua_skill.configuration.settings import Settings


async def restore(settings: Settings, backup: Path) -> Manifest:
    """Put a backup where ``settings`` look for their data, and return what was in it.

    Raises BackupFault, LibraryUnusable, ServedAlready or OSError; then nothing is there that was not there before.
    """
    data, database = settings.data.resolve(), database_file(settings)
    if database is None:
        raise BackupFault("the library is on a database server: back it up with its tools (pg_dump, pg_basebackup)")
    if (served := holder(settings)) is not None:
        raise BackupFault(f"{data} is served by {served}: stop that server first, or name another folder with --data")
    _check_empty(data, database, settings)
    manifest = read_backup(backup)
    with ExitStack() as undo:
        undo.enter_context(_made(data, database, settings))
        _check_empty(data, database, settings)  # now that nobody else can begin
        stage = data / f".restoring-{secrets.token_hex(4)}"
        undo.callback(shutil.rmtree, stage, ignore_errors=True)
        stage.mkdir(mode=0o700)
        copy = database.with_name(f".{database.name}.{secrets.token_hex(4)}")
        undo.callback(_unlink_library, copy)
        _copy_all(backup, manifest, stage, copy)
        await _opened(copy, manifest)
        placed: list[Path] = []
        undo.push(lambda kind, _error, _trace: _take_back(placed) if kind else None)
        for one in sorted(stage.iterdir()):
            placed.append(one.rename(data / one.name))
        # Last, so that a server finds all or, where this is interrupted, says that the library is missing.
        placed.append(copy.rename(database))
    return manifest


def _check_empty(data: Path, database: Path, settings: Settings) -> None:
    """Raise BackupFault if there is anything that a backup would replace."""
    locks = {file.name for file in lock_files(settings)}
    there = sorted(one.name for one in data.iterdir() if one.name not in locks) if data.is_dir() else []
    if there or database.exists():
        what = str(database) if database.exists() else str(data / there[0])
        raise BackupFault(f"{what} is there already: nothing is replaced, move it away or name another folder (--data)")


@contextmanager
def _made(data: Path, database: Path, settings: Settings) -> Iterator[None]:
    """Make the folders where there are none, and hold the lock; what was made is gone again when it goes wrong."""
    fresh = [folder for folder in (data, database.parent) if not folder.exists()]
    locks = [file for file in lock_files(settings) if not file.exists()]
    for folder in fresh:
        make_private(folder)
    lock = DataLock(settings)
    try:
        lock.take()
        yield
    except BaseException:
        for file in locks:
            file.unlink(missing_ok=True)
        for folder in fresh:
            if folder.exists() and not any(folder.iterdir()):
                folder.rmdir()
        raise
    finally:
        lock.release()


def _copy_all(backup: Path, manifest: Manifest, stage: Path, library: Path) -> None:
    """Copy what the manifest names, each file with its mode; the library and keys are their owner's alone."""
    for one in manifest.files:
        is_library = one.path == LIBRARY
        target = library if is_library else stage / Path(one.path).relative_to(FILES)
        make_private(target.parent)
        with (backup / one.path).open("rb") as read:
            descriptor = os.open(target, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "wb") as written:
                shutil.copyfileobj(read, written, 1 << 20)
                written.flush()
                os.fsync(written.fileno())
        private = is_library or target.suffix == ".pem"
        target.chmod(int(one.mode, 8) & ~OTHERS if private else int(one.mode, 8))


async def _opened(copy: Path, manifest: Manifest) -> None:
    """Open the library, which brings its tables up to date, and write into its trail that it was restored."""
    library = await SkillLibrary.open(copy, must_exist=True)
    try:
        told = {"made_at": manifest.made_at.isoformat(), "host": manifest.host, "program": manifest.program}
        await library.audit(AuditEntry("command line", "", "Restore", manifest.data, told, status="Good"))
    finally:
        await library.close()


def _unlink_library(file: Path) -> None:
    for end in ("", "-wal", "-shm", "-journal"):
        file.with_name(f"{file.name}{end}").unlink(missing_ok=True)


def _take_back(placed: list[Path]) -> None:
    remove: dict[bool, Callable[[Path], None]] = {True: shutil.rmtree, False: Path.unlink}
    for one in placed:
        remove[one.is_dir()](one)

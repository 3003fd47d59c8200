"""Who may look into files: what a server keeps is for its own user alone, and it says so where that is not the case."""

import os
import shlex
import stat
from dataclasses import dataclass
from pathlib import Path

OTHERS = stat.S_IRWXG | stat.S_IRWXO
TOLD_AT_MOST = 20


@dataclass(frozen=True, slots=True)
class Loose:
    """A file or folder that others than its owner may use, and its mode as `chmod` writes it."""

    path: Path
    mode: str

    def __str__(self) -> str:
        return f"{self.path} has mode {self.mode}: others than its owner may use it"


class KeyIsOpen(ValueError):
    """A private key that others may read: it is not used."""

    def __init__(self, file: Path, mode: str) -> None:
        super().__init__(
            f"the private key {file} has mode {mode}, others may read it: chmod 600 {shlex.quote(str(file))}, and if"
            " somebody has read it, move key and certificate away to have new ones made"
        )


def make_private(folder: Path) -> None:
    """Make a folder, and those above it that are missing, for this user alone; one that exists is left as it is."""
    missing: list[Path] = []
    while not folder.exists():
        missing.append(folder)
        folder = folder.parent
    for one in reversed(missing):
        one.mkdir(mode=0o700, exist_ok=True)


def write_private(file: Path, content: bytes) -> None:
    """Write a file that only this user may read, not for a moment anybody else."""
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as stream:
        stream.write(content)


def check_key(file: Path) -> None:
    """Raise KeyIsOpen for a private key that others than its owner may use."""
    if (mode := file.stat().st_mode) & OTHERS:
        raise KeyIsOpen(file, _octal(mode))


def loose(data: Path, *more: Path) -> list[Loose]:
    """Return what in a data folder others may use, and of the files named: the folder, keys, the database, traces.

    Inside a folder that is closed nothing is open, whatever its own mode says. Certificates are public.
    """
    found = [_loose(one) for one in more if one.exists()]
    if data.is_dir() and (itself := _loose(data)):
        inside = [*data.glob("*.db*"), *data.glob("*.lock"), *data.glob("certificates/**/*.pem"), data / "traces"]
        inside += sorted((data / "traces").glob("*"))[:TOLD_AT_MOST]
        found += [itself, *(_loose(one) for one in inside if one.exists())]
    return [one for one in found if one is not None][:TOLD_AT_MOST]


def _loose(path: Path) -> Loose | None:
    mode = path.stat().st_mode
    return Loose(path, _octal(mode)) if mode & OTHERS else None


def _octal(mode: int) -> str:
    return f"{stat.S_IMODE(mode):03o}"

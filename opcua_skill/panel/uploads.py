"""Uploaded recordings: read by the project's readers in a folder of their own, gone once they are read."""

import re
import tempfile
from pathlib import Path, PurePosixPath, PureWindowsPath

from library.errors import ReaderError
from library.readers import Choices, read
from models.demonstration import Demonstration

LARGEST = 200_000_000


def read_upload(name: str, content: bytes, choices: Choices | None = None) -> list[Demonstration]:
    """Return the demonstrations in an uploaded file; raises ReaderError with a sentence that names the file.

    The name a browser sends is never used as a path: only its last part, and of that only harmless characters.
    """
    last = PureWindowsPath(PurePosixPath(name).name).name
    harmless = re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-80:] or "upload"
    with tempfile.TemporaryDirectory(prefix="opcua-skill-upload-") as folder:
        file = Path(folder) / harmless
        file.write_bytes(content)
        return read(file, choices)


def plain_sentence(error: ReaderError) -> str:
    """Return what is wrong with a file without the folder it lay in for a moment."""
    return str(error).replace(f"{error.path.parent}/", "")

"""Uploaded recordings: read by the project's readers in a folder of their own, gone once they are read."""

import re
import tempfile
from pathlib import Path, PurePosixPath, PureWindowsPath

from library.readers import read
from models.demonstration import Demonstration

LARGEST = 200_000_000


def read_upload(name: str, content: bytes) -> list[Demonstration]:
    """Return the demonstrations in an uploaded file; raises ReaderError with a sentence that names the file.

    The name a browser sends is never used as a path: only its last part, and of that only harmless characters.
    """
    last = PureWindowsPath(PurePosixPath(name).name).name
    harmless = re.sub(r"[^A-Za-z0-9._-]", "_", last).lstrip(".")[-80:] or "upload"
    with tempfile.TemporaryDirectory(prefix="opcua-skill-upload-") as folder:
        file = Path(folder) / harmless
        file.write_bytes(content)
        return read(file)

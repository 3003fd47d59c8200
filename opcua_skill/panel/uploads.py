"""Uploaded recordings: read by the project's readers, without the samples that no camera saw."""

from library.readers import Choices, gaps, read_upload, without_gaps
from models.demonstration import Demonstration

LARGEST = 200_000_000


def uploaded(name: str, content: bytes, choices: Choices | None = None) -> tuple[list[Demonstration], list[str]]:
    """Return the demonstrations in an uploaded file as a server takes them, and a sentence for each that has gaps.

    Raises ReaderError, which names the file as the browser did, and ChoiceNeeded where the file leaves something open.
    """
    found = read_upload(name, content, choices)
    told = [f"{one.demonstration_id}: {missing.words()}" for one in found if (missing := gaps(one)).lost]
    return [without_gaps(one) for one in found], told

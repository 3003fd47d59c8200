"""The process that reads: a line of JSON names a file, the answer is a head in JSON and an archive of arrays."""

import io
import json
import os
import sys
from typing import Any, BinaryIO

import numpy as np

from library.errors import ChoiceNeeded, ReaderError
from library.readers.formats import read
from library.readers.import_options import Choices
from library.readers.isolation import MOST_MEMORY, MOST_SECONDS, OUT_OF_MEMORY, SIZES
from models.demonstration import Demonstration


def limit_memory() -> None:
    """Keep this process to its memory; where a system knows no such limits its parent ends it by time alone."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MOST_MEMORY, MOST_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def limit_time() -> None:
    """Keep the next file to its processor time."""
    try:
        import resource
    except ImportError:
        return
    used = resource.getrusage(resource.RUSAGE_SELF)
    end = int(used.ru_utime + used.ru_stime) + 1 + MOST_SECONDS
    resource.setrlimit(resource.RLIMIT_CPU, (end, resource.RLIM_INFINITY))


def packed(found: list[Demonstration]) -> tuple[bytes, bytes]:
    """Return demonstrations as JSON and an archive of arrays: nothing that is run when it is unpacked."""
    arrays: dict[str, Any] = {}
    for number, one in enumerate(found):
        arrays |= {f"times{number}": one.times, f"points{number}": one.points, f"triggers{number}": one.triggers}
        if one.orientations is not None:
            arrays[f"orientations{number}"] = one.orientations
    blob = io.BytesIO()
    np.savez(blob, **arrays)
    head = {"names": [one.demonstration_id for one in found], "source": found[0].source if found else ""}
    return json.dumps(head).encode(), blob.getvalue()


def answer(asked: dict[str, Any]) -> tuple[bytes, bytes]:
    """Return what stands in a file, or what is wrong with it."""
    try:
        return packed(read(asked["path"], Choices(**asked["choices"])))
    except ReaderError as error:
        told: dict[str, Any] = {"problem": error.problem, "remedy": error.remedy, "line": error.line}
        if isinstance(error, ChoiceNeeded):
            told |= {"choice": error.choice, "options": error.options}
        return json.dumps({"complaint": told}).encode(), b""


def main(asked: BinaryIO, answered: BinaryIO) -> None:
    """Answer line after line until there are no more."""
    limit_memory()
    for line in asked:
        limit_time()
        try:
            head, arrays = answer(json.loads(line))
        except MemoryError:
            os._exit(OUT_OF_MEMORY)
        answered.write(SIZES.pack(len(head), len(arrays)) + head)
        answered.write(arrays)
        answered.flush()


if __name__ == "__main__":
    main(sys.stdin.buffer, sys.stdout.buffer)

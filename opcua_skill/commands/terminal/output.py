"""How results are printed: tables and sentences for people, one JSON document for programs."""

import dataclasses
import json
import math
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

WITHOUT_TERMINAL = 10_000
"""columns of what is no terminal: a file or another program gets every line whole."""

screen = Console(highlight=False, width=None if sys.stdout.isatty() or "COLUMNS" in os.environ else WITHOUT_TERMINAL)
notes = Console(stderr=True, highlight=False)


def plain(value: Any) -> Any:
    """Return a value as JSON knows it: digests in hex, times in ISO form, NaN as null."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if callable(to_list := getattr(value, "tolist", None)):
        return plain(to_list())
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, str):
        return [plain(part) for part in value]
    return value


def print_json(value: Any) -> None:
    """Print one JSON document on one line: the last word of a command with ``--json``."""
    typer.echo(json.dumps(plain(value), ensure_ascii=False, allow_nan=False))


def say(sentence: str) -> None:
    """Print a result as a sentence. Text from the server is text, never markup."""
    screen.print(Text(sentence))


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number with what is counted: 1 job, 2 jobs. ``many`` is given where it is not ``one`` with an s."""
    return f"{number} {one if number == 1 else many or f'{one}s'}"


def note(sentence: str) -> None:
    """Print something beside the result, on stderr."""
    notes.print(Text(sentence), style="dim")


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> Table:
    """Return a table. A column whose head starts with ``>`` is aligned to the right.

    No cell is ever cut: long ones go on below. One whose head starts with ``=`` stays on one line however narrow the
    terminal: it holds what other commands are given.
    """
    made = Table(title=title, title_justify="left", header_style="bold", title_style="")
    for column in columns:
        whole = column.startswith("=")
        right = column.startswith(">")
        made.add_column(
            column.lstrip(">="), justify="right" if right else "left", overflow="fold", no_wrap=whole, min_width=4
        )
    for row in rows:
        made.add_row(*(Text(str(cell)) for cell in row))
    return made


def show_table(made: Table) -> None:
    """Print a table, wider than the terminal where what may not be broken needs it."""
    least = sum(
        max((cell.cell_len for cell in column.cells if isinstance(cell, Text)), default=0) if column.no_wrap else 4
        for column in made.columns
    )
    made.width = least if (least := least + 3 * len(made.columns) + 1) > screen.width else None
    screen.print(made, crop=False)


def millimetres(metres: float, digits: int = 3) -> str:
    """Return a length for people; an en dash for one that was not measured."""
    return f"{metres * 1000:.{digits}f}" if math.isfinite(metres) else "–"


def when(moment: datetime | None) -> str:
    """Return a moment in local time, for people."""
    return moment.astimezone().strftime("%Y-%m-%d %H:%M:%S") if moment else "–"

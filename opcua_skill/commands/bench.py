"""`bench`: the project's own benchmarks, each against a named peer, as one table of ratios."""

import dataclasses
import importlib
import inspect
import pkgutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import note, print_json, show_table, table

ROOT = Path(__file__).resolve().parents[2]
PLANNED = ("learning", "execution", "server", "start", "panel", "faces", "plant")
COLUMNS = ("name", "ours", "peer", "theirs", "ratio", "goal", "holds", "runs")


def suites() -> list[str]:
    """Return the suites that are there: modules of `benchmarks/` with a function ``rows``."""
    folder = ROOT / "benchmarks"
    if not folder.is_dir():
        return []
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    found = [module.name for module in pkgutil.iter_modules([str(folder)]) if not module.name.startswith("_")]
    return [name for name in found if "def rows(" in (folder / f"{name}.py").read_text(encoding="utf-8")]


def measured(suite: str, figures: Path | None) -> Iterator[Mapping[str, Any]]:
    """Yield a suite's rows as they are measured; one that draws puts its pictures into ``figures``."""
    rows = importlib.import_module(f"benchmarks.{suite}").rows
    draws = "figures" in inspect.signature(rows).parameters
    for row in rows(figures=figures) if draws else rows():
        given = row if isinstance(row, Mapping) else dataclasses.asdict(row)
        yield {column: given[column] for column in COLUMNS}


def bench(
    suite: Annotated[str, typer.Argument(help=f"one of {', '.join(PLANNED)} or another that is there; else all")] = "",
    figures: Annotated[
        Path | None, typer.Option(file_okay=False, help="folder for the pictures of a suite that draws (learning)")
    ] = None,
    as_json: Json = False,
) -> None:
    """Run the benchmarks. Ratios of one run mean something; absolute times depend on the machine."""
    there = suites()
    if not there:
        raise Fault("there are no benchmarks here: run `python3 dev.py bench` in a checkout of the project")
    if suite and suite not in there:
        later = suite in PLANNED
        raise Fault(
            f"suite {suite} {'comes in a later version' if later else 'is unknown'} (there are: {', '.join(there)})"
        )
    if not suite and (missing := [name for name in PLANNED if name not in there]):
        note(f"not there yet: {', '.join(missing)}")
    rows: list[Mapping[str, Any]] = []
    for name in [suite] if suite else there:
        note(f"measuring {name} …")
        for row in measured(name, figures):
            rows.append(row)
            if as_json:
                print_json(row)
    if not as_json:
        show_table(table("", COLUMNS, [[shown(row[column]) for column in COLUMNS] for row in rows]))
    if not all(row["holds"] for row in rows):
        raise Fault(f"missed: {', '.join(str(row['name']) for row in rows if not row['holds'])}")


def shown(value: Any) -> str:
    """Return a cell for people."""
    if isinstance(value, bool):
        return "yes" if value else "NO"
    return f"{value:.4g}" if isinstance(value, float) else str(value)

"""What a table shows can be copied into the next command, however narrow the terminal."""

import re
from collections.abc import Iterator

import pytest
from rich.console import Console

from opcua_skill.commands.terminal import output
from opcua_skill.jobs.ids import new_job_id

HEADS = ("=job", "kind", "state", "=recipe", ">samples")
ROWS = [("run-0maczfja-hnh7", "Execution", "Completed", "a-recipe-with-a-name-of-its-own", 1234)]


@pytest.fixture(params=[10_000, 120, 60, 30, 10])
def screen(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Console]:
    console = Console(width=request.param, record=True, quiet=False)
    monkeypatch.setattr(output, "screen", console)
    yield console


def test_no_table_cuts_a_name_and_those_that_commands_need_stay_on_one_line(screen: Console) -> None:
    output.show_table(output.table("", HEADS, ROWS))
    said = screen.export_text()
    assert "…" not in said
    for name in ("run-0maczfja-hnh7", "a-recipe-with-a-name-of-its-own"):
        assert name in said
    columns = [[part.strip() for part in line.split("│")[1:-1]] for line in said.splitlines() if line.startswith("│")]
    assert ["".join(cells) for cells in zip(*columns, strict=True)] == [str(cell) for cell in ROWS[0]]


def test_ids_of_jobs_are_short_rise_and_differ() -> None:
    made = [new_job_id("run") for _ in range(30)]
    assert all(re.fullmatch(r"run-[0-9a-hjkmnp-tv-z]{7}-[0-9a-hjkmnp-tv-z]{5}", one) for one in made)
    assert len(set(made)) == len(made)
    assert [one[:11] for one in made] == sorted(one[:11] for one in made)

"""The demo's own story on the strokes of twenty real people, as fast as the simulation allows."""

from pathlib import Path

import pytest

from library.readers import fit_to_plate, read_all
from models.demonstration import Demonstration
from models.synthetic import simulated_people
from opcua_skill.demo.plant import running_plant
from opcua_skill.demo.story import PRESETS, TRACKING_LIMIT, main_story

REAL = Path(__file__).parents[2].parent / "shared" / "data" / "twenty-people" / "zigzag-w"
pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]


def strokes() -> list[Demonstration]:
    """Return real people's strokes on the plate where they are at hand, else simulated ones."""
    files = sorted(REAL.glob("*.csv"))
    if not REAL.is_dir():
        return simulated_people(20)[0]
    assert len(files) >= 10, f"{REAL} is there but holds too little"
    return fit_to_plate(read_all(files))


async def test_the_better_version_of_real_people_runs_with_both_recipes() -> None:
    steps: list[str] = []
    async with running_plant("panda", realtime=False) as plant:
        outcome = await main_story(plant, strokes(), lambda doing, _: steps.append(doing))
    assert outcome.path_error(outcome.chosen) == min(outcome.path_error(preset) for preset in PRESETS)
    first, second = outcome.runs
    assert first.report.samples != second.report.samples
    for run in outcome.runs:
        assert run.report.state == "Completed"
        assert run.report.tracking_error[0] <= TRACKING_LIMIT
        assert len(run.trace.times) == len(run.trace.measured)
    assert any("approves" in step for step in steps)

"""A plant with two workstations, everybody signed in, and an empty recorder."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest_asyncio

from models.demonstration import Demonstration
from models.synthetic import simulated_people
from opcua_skill.client import Recorder, Refused, SkillClient

if TYPE_CHECKING:
    from tests.conftest import Plant

SETTINGS = """
[[workstations]]
name = "ws1"
driver = "kinematic"
realtime = false

[[workstations]]
name = "ws2"
driver = "kinematic"
realtime = false

[limits]
max_demonstrations = 12
max_points_per_demonstration = 60000
"""
PEOPLE = simulated_people(6)[0]
LIMIT = 60.0
PASSWORD = "correct horse battery"


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def plant(make_plant: Callable[..., "Plant"]) -> "Plant":
    return await asyncio.to_thread(make_plant, SETTINGS)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def people(plant: "Plant") -> AsyncIterator[dict[str, SkillClient]]:
    """Everybody, signed in once for all tests."""
    async with contextlib.AsyncExitStack() as stack:
        names = ("visitor", "mes", "teacher", "engineer")
        yield {name: await stack.enter_async_context(plant.sign_in(name)) for name in names}


@pytest_asyncio.fixture(loop_scope="module")
async def recorder(people: dict[str, SkillClient]) -> AsyncIterator[Recorder]:
    """The teacher's recorder on ws1, with nothing in it before and after."""
    mine = people["teacher"].workstation("ws1").recorder
    yield mine
    await empty(mine)


async def empty(recorder: Recorder) -> None:
    """Discard all recordings there are."""
    with contextlib.suppress(Refused):
        while True:
            view = await recorder.recording()
            await recorder.discard(view.recording_id)


async def until(holds: Callable[[], Awaitable[bool]]) -> None:
    """Wait until something holds."""
    async with asyncio.timeout(LIMIT):
        while not await holds():
            await asyncio.sleep(0.02)


async def show(recorder: Recorder, recording_id: str, shown: Demonstration, start: float) -> float:
    """Send a demonstration as a tracker does, with half a second of nothing pressed before; return when it ended."""
    pause = np.arange(0.0, 0.5, 0.02)
    times = start + np.concatenate([pause, 0.5 + shown.times])
    points = np.concatenate([np.repeat(shown.points[:1], len(pause), axis=0), shown.points])
    pressed = np.concatenate([np.zeros(len(pause), dtype=bool), np.ones(len(shown.times), dtype=bool)])
    for cut in range(0, len(times), 100):
        part = slice(cut, cut + 100)
        await recorder.append(recording_id, times[part], points[part], pressed[part])
    return float(times[-1]) + 0.01

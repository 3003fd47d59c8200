"""While a skill is learned or an arm moves, everybody else is served as if nothing went on.

Another client reads one value after another; what counts is the 99th percentile of its waiting times. The peer is the
same server with nothing else to do. Ratios within a run mean something; milliseconds depend on the machine.
"""

import asyncio
import os
import time
from collections.abc import Awaitable, Iterator
from typing import Any

import numpy as np

from models.people import simulated_people
from opcua_skill.client import SkillClient
from opcua_skill.demo.plant import Plant, running_plant

GOAL_MS = 50.0
IDLE_SECONDS = 5.0
PAUSE = 0.002
PEOPLE = simulated_people(20, rate=500.0)[0]
SKILL = "bench"


async def waits(client: SkillClient, until: "asyncio.Future[Any] | asyncio.Task[Any]") -> list[float]:
    """Return how long each read took, in ms, while something else goes on."""
    found: list[float] = []
    while not until.done():
        began = time.perf_counter()
        await client.session.read("Machines/ws1/Arm/ToolPose")
        found.append((time.perf_counter() - began) * 1000.0)
        await asyncio.sleep(PAUSE)
    await until
    return found


async def while_doing(plant: Plant, work: Awaitable[Any]) -> list[float]:
    """Return the waiting times of a visitor on a connection of its own during some work."""
    async with plant.sign_in("visitor") as visitor:
        return await waits(visitor, asyncio.ensure_future(work))


async def measured() -> dict[str, list[float]]:
    """Return waiting times by what went on meanwhile."""
    async with (
        running_plant("panda", realtime=True) as plant,
        plant.sign_in("teacher") as teacher,
        plant.sign_in("engineer") as engineer,
    ):
        found = {"idle": await while_doing(plant, asyncio.sleep(IDLE_SECONDS))}
        for preset in ("recommended", "paper"):
            found[f"learning, {preset} preset"] = await while_doing(plant, learn(teacher, preset))
        skill = await engineer.skill(SKILL, 1)
        await engineer.approve(SKILL, 1, skill.model_digest)
        await engineer.deploy(SKILL, 1, "ws1")
        found["the arm runs"] = await while_doing(plant, run(engineer))
    return found


async def learn(teacher: SkillClient, preset: Any) -> None:
    """Learn from twenty people at 500 samples a second."""
    from opcua_skill.client import LearningOptions

    report = await teacher.learn_to_the_end(
        SKILL, PEOPLE, semantic_type="Gluing", options=LearningOptions(preset=preset)
    )
    assert report.state == "Completed", report


async def run(engineer: SkillClient) -> None:
    """Plan and run the skill once."""
    started = await engineer.workstation("ws1").execute(SKILL)
    report = await engineer.follow(started.job_id, on="ws1")
    assert report.state == "Completed", report


def rows() -> Iterator[dict[str, Any]]:
    """Yield one row for each kind of work."""
    found = asyncio.run(measured())
    idle = float(np.percentile(found["idle"], 99))
    for doing, times in found.items():
        if doing == "idle":
            continue
        ours = float(np.percentile(times, 99))
        yield {
            "name": f"read while {doing}: p99, ms",
            "ours": ours,
            "peer": "the same server idle",
            "theirs": idle,
            "ratio": ours / idle,
            "goal": f"p99 <= {GOAL_MS:g} ms",
            "holds": ours <= GOAL_MS,
            "runs": len(times),
        }


if __name__ == "__main__":
    for row in rows():
        print(row)
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")

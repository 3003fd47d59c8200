"""While a skill is learned or an arm moves, everybody else is served as if nothing went on.

Another client, in a process of its own, reads one value after another; what counts is the 99th percentile of its
waiting times. The peer is the same server with nothing else to do. Ratios within a run mean something; milliseconds
depend on the machine and on what else it does.
"""

import asyncio
import multiprocessing
import os
import time
from collections.abc import Iterator
from multiprocessing.synchronize import Event
from typing import Any, Literal

import numpy as np

from models.synthetic import simulated_people
from opcua_skill.client import LearningOptions, SkillClient
from opcua_skill.demo.plant import Plant, running_plant

GOAL_MS = 50.0
IDLE_SECONDS = 8.0
PAUSE = 0.002
REPEATS = 5
PEOPLE = simulated_people(20, rate=500.0)[0]
SKILL = "bench"

Waits = list[tuple[float, float]]


def watch(plant: Plant, ready: Event, enough: Event, found: "multiprocessing.Queue[Waits]") -> None:
    """Read until told that it is enough; hand over when each read began, in s, and how long it took, in ms."""

    async def reading() -> Waits:
        waits: Waits = []
        async with plant.sign_in("visitor") as visitor:
            ready.set()
            while not enough.is_set():
                began = time.monotonic()
                await visitor.session.read("Machines/ws1/Arm/ToolPose")
                waits.append((began, (time.monotonic() - began) * 1000.0))
                await asyncio.sleep(PAUSE)
        return waits

    found.put(asyncio.run(reading()))


async def measured() -> dict[str, list[float]]:
    """Return waiting times in ms by what went on meanwhile."""
    spans: dict[str, tuple[float, float]] = {}
    context = multiprocessing.get_context("spawn")
    ready, enough, found = context.Event(), context.Event(), context.Queue()
    async with running_plant("panda", realtime=True) as plant:
        watcher = context.Process(target=watch, args=(plant, ready, enough, found))
        watcher.start()
        try:
            await asyncio.to_thread(ready.wait)
            spans["idle"] = await span(asyncio.sleep(IDLE_SECONDS))
            async with plant.sign_in("teacher") as teacher, plant.sign_in("engineer") as engineer:
                spans["learning, recommended preset"] = await span(learn(teacher, "recommended", REPEATS))
                spans["learning, paper preset"] = await span(learn(teacher, "paper", 1))
                await release(engineer)
                spans["the arm runs"] = await span(run(engineer))
            enough.set()
            waits = await asyncio.to_thread(found.get)
        finally:
            enough.set()
            await asyncio.to_thread(watcher.join, 30.0)
            watcher.kill()
    return {doing: [wait for at, wait in waits if begin <= at <= end] for doing, (begin, end) in spans.items()}


async def span(work: Any) -> tuple[float, float]:
    """Return when some work began and ended."""
    began = time.monotonic()
    await work
    return began, time.monotonic()


async def learn(teacher: SkillClient, preset: Literal["recommended", "paper"], times: int) -> None:
    """Learn from twenty people at 500 samples a second."""
    for seed in range(times):
        options = LearningOptions(preset=preset, seed=seed)
        report = await teacher.learn_to_the_end(SKILL, PEOPLE, semantic_type="Gluing", options=options)
        assert report.state == "Completed", report


async def release(engineer: SkillClient) -> None:
    """Approve and deploy what was learned first."""
    skill = await engineer.skill(SKILL, 1)
    await engineer.approve(SKILL, 1, skill.model_digest)
    await engineer.deploy(SKILL, 1, "ws1")


async def run(engineer: SkillClient) -> None:
    """Plan and run the skill once."""
    started = await engineer.workstation("ws1").execute(SKILL, mode="production")
    report = await engineer.follow(started.job_id, on="ws1")
    assert report.state == "Completed", report


def rows() -> Iterator[dict[str, Any]]:
    """Yield one row for each kind of work."""
    found = asyncio.run(measured())
    idle = float(np.percentile(found.pop("idle"), 99))
    for doing, times in found.items():
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

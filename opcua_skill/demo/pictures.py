"""The demo's pictures, all from what clients were told over OPC UA."""

import asyncio
import importlib.util
import json
import sys
from pathlib import Path

from opcua_skill.demo.plant import Plant, PlantFailed
from opcua_skill.demo.story import PRESETS, SKILL, Outcome
from opcua_skill.figures import Run, learning_figure, runs_figure, view_of

ARTIST = "sim.picture"
PATIENCE = 120.0


async def draw(plant: Plant, outcome: Outcome, arm: str, folder: Path) -> list[Path]:
    """Write the pictures into a folder and return their files."""
    async with plant.sign_in("visitor") as visitor:
        views = [
            await view_of(visitor, SKILL, outcome.skills[preset].version, f"preset {preset}") for preset in PRESETS
        ]
    runs = [
        Run(
            f"recipe {run.recipe.recipe_id}: {run.report.samples} steps of {run.recipe.time_step * 1000:g} ms",
            run.trace,
        )
        for run in outcome.runs
    ]
    files = [folder / "figure-3.png", folder / "commanded-measured.png"]
    await asyncio.to_thread(learning_figure, views, files[0])
    await asyncio.to_thread(runs_figure, runs, files[1])
    if importlib.util.find_spec(ARTIST) is not None and outcome.joints:
        files.append(await draw_arm(outcome, arm, folder / "arm.png"))
    return files


async def draw_arm(outcome: Outcome, arm: str, file: Path) -> Path:
    """Write a picture of the arm on its way, drawn by a process of its own from joints and measured path."""
    scene = {"arm": arm, "joints": list(outcome.joints), "path": outcome.runs[0].trace.measured.tolist()}
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", ARTIST, "-o", str(file)),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(PATIENCE):
            _, complaint = await process.communicate(json.dumps(scene).encode())
    finally:
        if process.returncode is None:
            process.kill()
    if process.returncode:
        raise PlantFailed(f"the arm could not be drawn: {complaint.decode().strip()[-300:]}")
    return file

"""The demo's pictures, all from what clients were told over OPC UA."""

import asyncio
from pathlib import Path

from opcua_skill.client.figures import Run, learning_figure, runs_figure, view_of
from opcua_skill.demo.plant import Plant, command, finished
from opcua_skill.demo.story import PRESETS, SKILL, Outcome


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
    files.append(await draw_arm(plant, outcome, arm, folder / "arm.png"))
    return files


async def draw_arm(plant: Plant, outcome: Outcome, arm: str, file: Path) -> Path:
    """Write the operator's card of the first recipe, by the command that everybody has for it."""
    recipe, version = outcome.runs[0].recipe, outcome.skills[outcome.chosen].version
    words = ("recipes", "picture", recipe.recipe_id, "--arm", arm, "--version", str(version), "-o", str(file))
    sign_in = {"OPCUA_SKILL_PASSWORD": plant.passwords["mes"], "OPCUA_SKILL_CLIENT_DIR": str(plant.client_folder)}
    await finished(command(*words, "--user", "mes", "--server", plant.url), "drawing the arm", {**sign_in})
    return file

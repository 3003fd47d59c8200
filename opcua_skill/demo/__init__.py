"""`opcua-skill demo`: the main job, end to end, on a server of its own."""

import asyncio
import json
import signal
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from opcua_skill.client import ClientError
from opcua_skill.demo.people import Shown, shown_by
from opcua_skill.demo.pictures import draw
from opcua_skill.demo.plant import Plant, panel_beside, running_plant
from opcua_skill.demo.story import Outcome, StepFailed, main_story
from opcua_skill.demo.telling import as_json, print_table


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the person asked for. ``people``: "lasa", "simulated", or "" for the first that is there."""

    people: str = ""
    files: tuple[Path, ...] = ()
    arm: str = "panda"
    out: Path = Path("demo-output")
    keep_serving: bool = False
    as_json: bool = False


class DemoFailed(ClientError):
    """Something that has to hold did not."""


async def main_job(wishes: Wishes) -> None:
    """Play the story, draw the pictures, print the table; SIGTERM ends it as Ctrl-C does."""
    task = asyncio.current_task()
    assert task is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, task.cancel)
    shown = await asyncio.to_thread(shown_by, wishes.people, wishes.files)
    screen = Console(highlight=False, stderr=wishes.as_json)
    screen.print(f"learning from {shown.source}")
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True)) as progress:
        step = Steps(progress)
        step("the server starts, security on", 0.0)
        async with running_plant(wishes.arm) as plant:
            outcome, pictures = await play(plant, shown, wishes, step)
            step.done()
            progress.stop()
            print_table(screen, shown, outcome, pictures)
            if wishes.keep_serving:
                await stay(plant, screen)
    if wishes.as_json:
        print_line(as_json(outcome, pictures))


async def play(plant: Plant, shown: Shown, wishes: Wishes, step: "Steps") -> tuple[Outcome, list[Path]]:
    """Return what the story came to, and its pictures."""
    try:
        outcome = await main_story(plant, shown.demonstrations, step)
    except StepFailed as unmet:
        raise DemoFailed(str(unmet)) from None
    step("drawing", 0.0)
    return outcome, await draw(plant, outcome, wishes.arm, wishes.out)


async def stay(plant: Plant, screen: Console) -> None:
    """Leave server and panel up until Ctrl-C, and say how to look around."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for name in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(name, stop.set)
    async with panel_beside(plant) as panel:
        screen.print(f"server: {plant.url}", f"panel:  {panel}", "Ctrl-C ends both; sign in as", sep="\n", markup=False)
        for user, password in plant.passwords.items():
            screen.print(f"  {user:10} {password}", markup=False)
        screen.print(
            "on the command line:",
            f"  export OPCUA_SKILL_SERVER={plant.url} OPCUA_SKILL_CLIENT_DIR={plant.client_folder}",
            "  OPCUA_SKILL_PASSWORD=… opcua-skill skills list --user visitor",
            sep="\n",
            soft_wrap=True,
            markup=False,
        )
        await stop.wait()


def print_line(values: dict[str, Any]) -> None:
    """Print the last line of `--json`."""
    Console(highlight=False, soft_wrap=True, markup=False).print(json.dumps(values))


class Steps:
    """Shows one bar a step; a new description finishes the bar before."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._now = ""
        self._task: Any = None

    def __call__(self, doing: str, fraction: float) -> None:
        if doing != self._now:
            self.done()
            self._now, self._task = doing, self._progress.add_task(doing, total=1.0)
        self._progress.update(self._task, completed=fraction)

    def done(self) -> None:
        """Finish the bar of the step that runs now."""
        if self._task is not None:
            self._progress.update(self._task, completed=1.0)
            self._progress.stop_task(self._task)

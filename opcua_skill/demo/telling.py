"""What the demo prints at its end: one table for people, one line for programs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from opcua_skill.demo.people import Shown
from opcua_skill.demo.story import PRESETS, Outcome


def as_json(outcome: Outcome, pictures: Sequence[Path]) -> dict[str, Any]:
    """Return the values of `demo --json`."""
    return {
        "seconds_to_first_run": round(outcome.seconds_to_first_run, 3),
        "path_error_mm": {preset: outcome.path_error(preset) * 1000 for preset in PRESETS},
        "runs": [
            {
                "recipe": run.recipe.recipe_id,
                "time_step_s": run.recipe.time_step,
                "samples": run.report.samples,
                "tracking_rms_mm": run.report.tracking_error[0] * 1000,
                "tracking_max_mm": run.report.tracking_error[1] * 1000,
            }
            for run in outcome.runs
        ],
        "pictures": [str(picture) for picture in pictures],
    }


def print_table(screen: Console, shown: Shown, outcome: Outcome, pictures: Sequence[Path]) -> None:
    """Print the one table: from the first demonstration to the runs."""
    table = Table(title=f"From {shown.source} to a running arm", title_justify="left", show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("first demonstration to first finished run", f"{outcome.seconds_to_first_run:.1f} s")
    table.add_section()
    for preset in PRESETS:
        chosen = ", approved and deployed" if preset == outcome.chosen else ""
        skill = outcome.skills[preset]
        table.add_row(
            f"path error, {preset} preset ({len(skill.means)} components{chosen})",
            f"{outcome.path_error(preset) * 1000:.2f} mm RMS",
        )
    for run in outcome.runs:
        rms, largest = run.report.tracking_error
        table.add_section()
        pace = f" at {run.recipe.speed * 1000:g} mm/s" if run.recipe.timing == "constant_speed" else ", as demonstrated"
        table.add_row(f"recipe {run.recipe.recipe_id}: {run.recipe.time_step * 1000:g} ms steps{pace}", "")
        table.add_row("  time steps", str(run.report.samples))
        table.add_row("  measured against commanded", f"{rms * 1000:.4f} mm RMS, {largest * 1000:.4f} mm at most")
    screen.print(table)
    screen.print("path error: learned path against the mean of the aligned demonstrations; the arm is simulated")
    screen.print("pictures: " + ", ".join(str(picture) for picture in pictures), soft_wrap=True)

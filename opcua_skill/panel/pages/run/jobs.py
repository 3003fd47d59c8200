"""The newest jobs of a workstation as a table: what each measured, to be looked at again or taken away as CSV."""

import math
from collections.abc import Awaitable, Callable
from dataclasses import replace

from nicegui import ui

from opcua_skill.client import JobReport
from opcua_skill.panel.formatting import mm, moment, state_tag
from opcua_skill.panel.layout import Frame
from opcua_skill.panel.modes import mode_tag
from opcua_skill.panel.pages.run.motion import told_of_run

SHOWN_JOBS = 10
HEADS = ("When", "Skill", "Recipe", "Mode", "State", "Measured from commanded: RMS / largest", "Record")


def told_of(jobs: tuple[JobReport, ...]) -> str:
    """Return what is said of jobs, without what changes several times a second while one runs."""
    return repr([replace(one, progress=0.0) for one in jobs])


def recorded(job: JobReport) -> bool:
    """Whether there is a record of a run: of every one that began to move and has ended, however it ended."""
    return job.ended and job.start_time is not None


class JobTable:
    """The table. ``play`` shows a run's record, ``download`` gives it away."""

    def __init__(
        self,
        frame: Frame,
        play: Callable[[JobReport], Awaitable[None]],
        download: Callable[[JobReport], Awaitable[None]],
    ) -> None:
        self.frame, self.words, self.play, self.download = frame, frame.words, play, download
        with ui.element("table").classes("panel-table jobs-table run-jobs").props('data-mark="jobs"') as table:
            self.table = table
        self.told = ""

    def show(self, jobs: tuple[JobReport, ...]) -> None:
        """Show jobs, the newest first. Rows are made anew only when they say something else: no press is lost."""
        words, told = self.words, told_of(jobs[:SHOWN_JOBS])
        if told == self.told:
            return
        self.told = told
        self.table.clear()
        with self.table:
            with ui.element("tr"):
                for head in HEADS:
                    with ui.element("th").props("scope=col"):
                        ui.label(words(head))
            for one in jobs[:SHOWN_JOBS]:
                self._row(one)
            if not jobs:
                with ui.element("tr"), ui.element("td").props("colspan=7").classes("soft"):
                    ui.label(words("Nothing has run here yet."))

    def _row(self, one: JobReport) -> None:
        words = self.words
        with ui.element("tr"):
            for cell in (moment(one.start_time), f"{one.skill_name} {one.skill_version}", one.recipe_id):
                with ui.element("td"):
                    ui.label(cell)
            with ui.element("td"):
                ui.html(mode_tag(words, one.mode), sanitize=False)
            with ui.element("td").classes("wraps"):
                ui.html(state_tag(words, one.state), sanitize=False)
                if one.failure:
                    ui.label(f"{words(one.failure.value)}: {words.said(one.message)}").classes("small check-bad")
                elif one.message:
                    ui.label(told_of_run(words.said, one)).classes("small lines soft")
            with ui.element("td"):
                rms, largest = one.tracking_error
                known = recorded(one) and math.isfinite(rms)
                ui.label(words.figures(f"{mm(rms, 3)} / {mm(largest, 3)}") if known else "–").classes("mono")
            with ui.element("td"):
                if recorded(one):
                    self._record(one)

    def _record(self, one: JobReport) -> None:
        words, name = self.words, f"{one.skill_name} {moment(one.start_time)}"
        with ui.element("div").classes("line").style("flex-wrap: nowrap"):
            show = ui.button(words("Replay"), icon="history", on_click=lambda: self.play(one))
            show.props('no-caps flat dense data-mark="play-run"').classes("replay-button")
            show.props["aria-label"] = f"{words('Replay')} {name}"
            save = ui.button("CSV", icon="download", on_click=lambda: self.download(one))
            save.props('no-caps flat dense data-mark="csv"').props["aria-label"] = f"CSV {name}"

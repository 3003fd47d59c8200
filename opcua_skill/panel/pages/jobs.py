"""The newest jobs of a workstation as a table: what each measured, to be played or taken away as CSV."""

from collections.abc import Awaitable, Callable
from dataclasses import replace

from nicegui import ui

from opcua_skill.client import JobReport
from opcua_skill.panel.frame import Frame
from opcua_skill.panel.shown import mm, moment, state_tag

SHOWN_JOBS = 10


def told_of(jobs: tuple[JobReport, ...]) -> str:
    """Return what is said of jobs, without what changes several times a second while one runs."""
    return repr([replace(one, progress=0.0) for one in jobs])


class JobTable:
    """The table. ``play`` shows a run's record, ``download`` gives it away."""

    def __init__(
        self,
        frame: Frame,
        play: Callable[[str, bool], Awaitable[None]],
        download: Callable[[str], Awaitable[None]],
    ) -> None:
        self.frame, self.words, self.play, self.download = frame, frame.words, play, download
        with ui.element("table").classes("panel-table jobs-table").props('data-mark="jobs"') as table:
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
                for head in ("When", "Skill", "Recipe", "Mode", "State", "Measured from commanded: RMS / largest", ""):
                    with ui.element("th"):
                        ui.label(words(head))
            for one in jobs[:SHOWN_JOBS]:
                self._row(one)
            if not jobs:
                with ui.element("tr"), ui.element("td").props("colspan=7").classes("soft"):
                    ui.label(words("Nothing has run here yet."))

    def _row(self, one: JobReport) -> None:
        words = self.words
        with ui.element("tr"):
            for cell in (
                moment(one.start_time),
                f"{one.skill_name} {one.skill_version}",
                one.recipe_id,
                words(one.mode),
            ):
                with ui.element("td"):
                    ui.label(cell)
            with ui.element("td").classes("wraps"):
                ui.html(state_tag(words, one.state), sanitize=False)
                if one.failure != "None":
                    ui.label(f"{words(one.failure)}: {words.said(one.message)}").classes("small check-bad")
            with ui.element("td"):
                rms, largest = one.tracking_error
                ui.label(
                    words.figures(f"{mm(rms, 3)} / {mm(largest, 3)}") if one.state == "Completed" else "–"
                ).classes("mono")
            with ui.element("td"):
                if one.state == "Completed":
                    with ui.element("div").classes("line").style("flex-wrap: nowrap"):
                        ui.button(words("Play"), on_click=lambda: self.play(one.job_id, True)).props(
                            'no-caps flat dense data-mark="play-run"'
                        )
                        ui.button("CSV", icon="download", on_click=lambda: self.download(one.job_id)).props(
                            'no-caps flat dense data-mark="csv"'
                        )

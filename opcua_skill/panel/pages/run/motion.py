"""What moves here now: the job and its mode, what the server tells of it, pause, abort, speed; and what waits."""

import re
from collections.abc import Callable

from nicegui import ui

from opcua_skill.client import JobReport
from opcua_skill.panel.formatting import percent, state_tag
from opcua_skill.panel.layout import Frame, title
from opcua_skill.panel.modes import mode_tag, moves
from opcua_skill.panel.pages.run.held import BECAUSE, HeldQueue

DIGEST, SHORT = re.compile(r"\b([0-9a-f]{12})[0-9a-f]{52}\b"), r"\1…"
STEPS = {"pause": "Pause", "resume": "Go on", "abort": "Abort"}


class MotionSheet:
    """The sheet on the run page; `refresh` shows what the session knows."""

    def __init__(self, frame: Frame) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        self.queued: list[str] = []
        self.shown_override = 0
        words = self.words
        title(words("Motion"))
        with ui.element("div").classes("line").props("role=status"):
            self.mode = ui.html("", sanitize=False).props('data-mark="job-mode"')
            self.job = ui.html("", sanitize=False).props('data-mark="job"')
        self.job_told = ui.label().classes("small")
        self.progress = ui.linear_progress(0.0, show_value=False, size="10px").props("instant-feedback")
        self.progress.props["aria-label"] = words("how far the job is")
        self.notes = ui.label().classes("small lines check-flag").props('data-mark="job-notes"')
        with ui.element("div").classes("line"):
            self.pause = ui.button(words("Pause"), icon="pause", on_click=lambda: self.steer("pause"))
            self.pause.props("no-caps outline dense").props('data-mark="pause"')
            self.resume = ui.button(words("Go on"), icon="play_arrow", on_click=lambda: self.steer("resume"))
            self.resume.props("no-caps outline dense").props('data-mark="resume"')
            self.abort = ui.button(words("Abort"), icon="stop", on_click=lambda: self.steer("abort"))
            self.abort.props("no-caps outline dense color=negative").props('data-mark="abort"')
        self.why = ui.label().classes("small soft").props('data-mark="why-steer"')
        self.held = HeldQueue(frame)
        self.queue = ui.element("div").classes("stack").props('data-mark="queue"')
        self.override_told = ui.label().classes("small").props('data-mark="override-told"')
        self.override = ui.slider(min=5, max=100, step=5, value=100).props(
            f'label snap aria-label="{words("Speed override")}"'
        )
        self.override.on("change", self.set_override).props('data-mark="override"')

    def active(self) -> JobReport | None:
        """Return the job that moves or waits here: what moves the arm before what is only simulated."""
        jobs = sorted(self.session.station.active, key=moves, reverse=True)
        running = [one for one in jobs if one.state != "Queued"]
        return next(iter(running or jobs[-1:]), None)

    def refresh(self) -> None:
        """Show what the session knows of job, queue and speed."""
        session, words, job = self.session, self.words, self.active()
        waiting = [one for one in reversed(session.station.active) if one.state == "Queued"]
        if job is None:
            self.mode.content, self.job.content = "", words("Nothing runs here.")
            self.job_told.text, self.notes.text, self.progress.value = "", "", 0.0
        else:
            self.mode.content, self.job.content = mode_tag(words, job.mode), state_tag(words, job.state)
            rest = f" · {len(waiting)} {words('waiting')}" if waiting else ""
            told = f"{job.skill_name} {words('version')} {job.skill_version} · {job.recipe_id}"
            self.job_told.text = f"{told} · {percent(job.progress)}{rest}"
            unasked = [words(BECAUSE.get(job.cause, job.cause))] if job.state == "Paused" and job.cause else []
            self.notes.text = "\n".join([*unasked, told_of_run(words.said, job)])
            flagged = bool(unasked) or job.slowed_to > 0.0
            self.notes.classes(replace=f"small lines {'check-flag' if flagged else 'soft'}")
            self.progress.value = job.progress
        may = session.live and session.may("run")
        self.pause.set_enabled(may and job is not None and job.state == "Running")
        self.resume.set_enabled(may and job is not None and job.state == "Paused")
        self.abort.set_enabled(may and job is not None and job.state != "Stopping")
        if not session.live:
            self.why.text = words("no connection, or the server does not answer")
        else:
            self.why.text = "" if session.may("run") else words("needs the role operator")
        self.override.set_enabled(may)
        self._show_override()
        self.held.refresh(waiting)
        self._show_queue(waiting)

    def _show_override(self) -> None:
        arm, words = self.session.station.arm, self.words
        if arm is None:
            return
        self.override_told.text = f"{words('Speed override')}: {percent(arm.speed_override)}"
        if (told := round(100.0 * arm.speed_override)) != self.shown_override:
            self.shown_override = told  # somebody set it, here or elsewhere: the slider never says something else
            self.override.value = told

    def _show_queue(self, waiting: list[JobReport]) -> None:
        """List what waits, the next one first; each can be taken out."""
        words, ids = self.words, [one.job_id for one in waiting]
        if ids == self.queued:
            return
        self.queued = ids
        self.queue.clear()
        with self.queue:
            if waiting:
                ui.label(f"{words('Queue')}: {len(waiting)} {words('waiting')}").classes("small soft")
            for place, one in enumerate(waiting, start=1):
                with ui.element("div").classes("line queued"):
                    ui.label(f"{place}. {one.skill_name} {one.skill_version} · {words(one.mode)}").classes("small")
                    ui.space()
                    ui.button(icon="close", on_click=lambda _, it=one: self.take_out(it)).props("flat round").props[
                        "aria-label"
                    ] = f"{words('Take out of the queue')} {place}"

    async def steer(self, what: str) -> None:
        """Pause, resume or abort what runs here."""
        job, words = self.active(), self.words
        if job is None:
            return
        workstation = self.session.client.workstation(self.session.station_name)
        ask = {"pause": workstation.pause, "resume": workstation.resume, "abort": workstation.abort}[what]
        await self.frame.asked(words(STEPS[what]), lambda: ask(job.job_id))
        self.session.look_again()

    async def take_out(self, job: JobReport) -> None:
        """Abort a job that waits."""
        workstation = self.session.client.workstation(self.session.station_name)
        await self.frame.asked(self.words("Abort"), lambda: workstation.abort(job.job_id))
        self.session.look_again()

    async def set_override(self) -> None:
        """Slow the arm down, or let it go faster again."""
        station, wanted = self.session.station_name, float(self.override.value or 100.0)
        workstation = self.session.client.workstation(station)
        if not await self.frame.asked(
            self.words("Speed override"), lambda: workstation.set_speed_override(wanted / 100.0)
        ):
            self.shown_override = 0  # shows again what is true
        self.session.look_again()


def told_of_run(said: Callable[[object], str], job: JobReport) -> str:
    """Return what the server tells of a run, a line a thing, with its plan's digest cut short."""
    return "\n".join(said(part) for part in DIGEST.sub(SHORT, job.message).split("; ") if part)

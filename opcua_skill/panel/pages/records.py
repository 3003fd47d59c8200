"""Records: what the server told since one signed in (audit events among it), and the jobs of every workstation."""

import math
import re
from collections.abc import Iterable

from nicegui import ui

from opcua_skill.panel.formatting import mm, moment, state_tag
from opcua_skill.panel.layout import Frame, title
from opcua_skill.panel.modes import mode_tag
from opcua_skill.panel.pages.run.jobs import told_of
from opcua_skill.panel.session import Happening

MOST = 150
SEVERE = 500
DIGEST, SHORT = re.compile(r"\b([0-9a-f]{12})[0-9a-f]{52}\b"), r"\1…"


def changes(happenings: Iterable[Happening]) -> list[Happening]:
    """Return what is worth a line, newest first: a job that says again that it runs is not."""
    told: set[str] = set()
    kept = []
    for one in happenings:
        if one.event.job_id and one.event.message in told:
            continue
        told.add(one.event.message)
        kept.append(one)
    return kept[:MOST]


async def records_page(frame: Frame) -> None:
    """Show events and jobs, newest first; both go on while one looks."""
    words, session = frame.words, frame.session
    with ui.element("div").classes("columns half-columns"):
        with ui.element("div").classes("sheet stack"):
            title(words("What happened since you signed in"))
            with ui.element("div").classes("line"):
                only = ui.checkbox(words("only refusals, faults and stops")).props("dense")
                ui.space()
                ui.button(words("Audit trail"), icon="fact_check", on_click=lambda: ui.navigate.to("/audit")).props(
                    'no-caps outline data-mark="to-audit"'
                )
            with (
                ui.element("div").classes("scrolls").props("tabindex=0"),
                ui.element("table").classes("panel-table jobs-table").props('data-mark="events"') as events,
            ):
                pass
        with ui.element("div").classes("sheet stack"):
            title(words("Jobs"))
            with (
                ui.element("div").classes("scrolls").props("tabindex=0"),
                ui.element("table").classes("panel-table jobs-table").props('data-mark="all-jobs"') as jobs,
            ):
                pass
    shown: dict[str, object] = {}

    def show() -> None:
        newest = (session.happenings[0].number if session.happenings else 0, only.value)
        if shown.get("events") != newest:
            shown["events"] = newest
            events.clear()
            with events:
                for one in [it for it in changes(session.happenings) if not only.value or it.event.severity >= SEVERE]:
                    with ui.element("tr"):
                        with ui.element("td"):
                            ui.label(f"{one.at.astimezone():%H:%M:%S}").classes("mono")
                        with ui.element("td").classes("wraps"):
                            bad = one.event.severity >= SEVERE
                            label = ui.label(f"{'⚠ ' if bad else ''}{words.said(DIGEST.sub(SHORT, one.event.message))}")
                            if bad:
                                label.classes("check-bad")
        known = [told_of(station.jobs) for station in session.stations.values()]
        if shown.get("jobs") != known:
            shown["jobs"] = known
            jobs.clear()
            with jobs:
                with ui.element("tr"):
                    for head in ("When", "Workstation", "Skill", "Mode", "State", "RMS / largest"):
                        with ui.element("th"):
                            ui.label(words(head))
                for station in session.stations.values():
                    for job in station.jobs[:50]:
                        with ui.element("tr"):
                            name = f"{job.skill_name} {job.skill_version}"
                            for cell in (moment(job.start_time), station.name, name):
                                with ui.element("td"):
                                    ui.label(cell)
                            with ui.element("td"):
                                ui.html(mode_tag(words, job.mode), sanitize=False)
                            with ui.element("td").classes("wraps"):
                                ui.html(state_tag(words, job.state), sanitize=False)
                                if job.failure:
                                    ui.label(f"{words(job.failure.value)}: {words.said(job.message)}").classes(
                                        "small check-bad"
                                    )
                            with ui.element("td").classes("wraps"):
                                rms, largest = job.tracking_error
                                done = math.isfinite(rms)
                                ui.label(words.figures(f"{mm(rms, 3)} / {mm(largest, 3)}") if done else "–").classes(
                                    "mono"
                                )

    frame.on_refresh(show)

"""The list of a version's demonstrations: in or out, how far off, and what learning said of each, worst first."""

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from opcua_skill.panel.formatting import mm, percent
from opcua_skill.panel.layout import title
from opcua_skill.panel.pages.skill.reviewed import ReviewPage


class DemonstrationList:
    """The left column of a skill's page."""

    def __init__(self, page: ReviewPage) -> None:
        self.page = page
        words = page.words
        version = page.version
        errors = {one["demonstration_id"]: one for one in version.skill.report.get("demonstrations") or ()}
        names = sorted(
            version.material.raw,
            key=lambda name: (name not in version.flagged, -float(errors.get(name, {}).get("max", 0.0))),
        )
        flagged = len(version.flagged)
        title(words.count(len(names), "demonstration", "demonstrations"))
        note = f"{flagged} {words('flagged')}" if flagged else words("none flagged")
        ui.label(f"{note} · {words('largest distance from the path and where, worst first')}").classes("small soft")
        self._rows: dict[str, tuple[ui.element, ui.checkbox, ui.button]] = {}
        with ui.element("div").classes("demo-list"):
            for name in names:
                self._row(name, errors.get(name, {}))

    def _row(self, name: str, error: Mapping[str, Any]) -> None:
        page, words = self.page, self.page.words
        verdict = page.version.verdicts.get(name, {})
        with ui.element("div").classes("demo") as row:
            row.props["data-mark"] = f"demo-{name}"
            box = ui.checkbox(value=True).props("dense")
            box.props["aria-label"] = f"{words('use')} {name}"
            box.on("update:model-value", lambda _: page.include(name, bool(box.value)))
            box.set_enabled(page.session.may("edit"))
            label = ui.label(name).classes("demo-name")
            raw = page.version.material.raw[name]
            label.tooltip(
                " · ".join(
                    part
                    for part in (raw.operator, raw.source, words.count(len(raw.times), "sample", "samples"))
                    if part
                )
            )
            with ui.element("div").classes("line").style("width:auto;flex-wrap:nowrap;gap:2px"):
                there = f" · {percent(error['place'])}" if error.get("place") is not None else ""
                ui.label(words.figures(f"{mm(error.get('max'), 1)}{there}")).classes("small mono")
                back = ui.button(icon="restore", on_click=lambda: self._restore(name)).props("flat dense round size=xs")
                back.tooltip(words("Take its struck samples in again"))
            if name in page.version.flagged:
                place = verdict.get("place")
                where = f"{words('at')} {percent(place)}: " if place is not None else ""
                ui.label(f"⚠ {where}{words.said(page.version.flagged[name])}").classes("demo-why")
            elif verdict.get("fault") == "excluded":
                ui.label(words("taken out by a person")).classes("demo-why soft")
        row.on("mouseenter", lambda: page.chart.overlay(highlight=name), throttle=0.15)
        row.on("mouseleave", lambda: page.chart.overlay(highlight=None), throttle=0.15)
        self._rows[name] = (row, box, back)

    def _restore(self, name: str) -> None:
        self.page.version.draft.restore_all(name)
        self.page.refresh()

    def refresh(self) -> None:
        """Show which demonstrations are in, and which have struck samples."""
        edits = self.page.edits
        for name, (row, box, back) in self._rows.items():
            gone = name in edits.excluded
            if box.value == gone:
                box.set_value(not gone)
            if gone:
                row.classes("demo-excluded")
            else:
                row.classes(remove="demo-excluded")
            back.set_visibility(bool(edits.struck.get(name)))

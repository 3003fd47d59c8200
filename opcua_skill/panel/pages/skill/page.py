"""A skill's page: look at the demonstrations, take out what is wrong, learn again, judge, deploy."""

import json
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import quote

from nicegui import ui

from models.demonstration import Edits
from opcua_skill.client import Path, Skill
from opcua_skill.panel.chart import ReviewChart, chart_data, packed_path, thinned
from opcua_skill.panel.comparing import told_distance
from opcua_skill.panel.formatting import mm, percent
from opcua_skill.panel.layout import Frame, choose
from opcua_skill.panel.pages.skill.comparison import Comparison
from opcua_skill.panel.pages.skill.demonstrations import DemonstrationList
from opcua_skill.panel.pages.skill.judging import Judging
from opcua_skill.panel.pages.skill.reviewed import Version, read_version
from opcua_skill.panel.review import instants_struck, largest_change

LEARNING_LIMIT = 600.0


async def skill_page(frame: Frame, name: str, version: str = "0") -> None:
    """Show the newest version, or the one asked for."""
    page = SkillPage(frame, name)
    await page.open(int(version) if version.isdigit() else 0)


class SkillPage:
    """The page as one browser sees it."""

    def __init__(self, frame: Frame, name: str) -> None:
        self.frame = frame
        self.words = frame.words
        self.session = frame.session
        self.name = name
        self.state: dict[str, Any] = {
            "view": "path",
            "mode": "aligned",
            "tube": True,
            "components": False,
            "tool": "point",
            "target": "one",
        }
        self.version: Version
        self.chart: ReviewChart
        self.demonstrations: DemonstrationList
        self.ghost: Path | None = None
        self.busy = False

    async def open(self, number: int) -> None:
        """Build the page for a version."""
        self.place = ui.element("div").classes("w-full")
        if not await self.show(number):
            with self.place:
                ui.label(self.words("This skill cannot be shown.")).classes("sheet")
            return
        ui.keyboard(on_key=self._key)
        self.seen = self.session.happenings[0].number if self.session.happenings else 0
        ui.timer(0.5, self._look)

    async def show(self, number: int) -> bool:
        """Read a version and show it in place of what was there."""

        async def read() -> None:
            self.version = await read_version(self.session, self.name, number)

        if not await self.frame.asked(self.words("Read the skill"), read):
            return False
        self.place.clear()
        with self.place:
            self._build()
            address = f"/skill/{quote(self.name, safe='')}?version={self.version.skill.version}"
            ui.run_javascript(f"history.replaceState(history.state, '', {json.dumps(address)})")
        return True

    def _build(self) -> None:
        version, words = self.version, self.words
        with ui.element("div").classes("columns review-columns"):
            with ui.element("div").classes("sheet stack"):
                self.demonstrations = DemonstrationList(self)
            with ui.element("div").classes("sheet stack"):
                self._tools()
                data = chart_data(words, version.skill, version.material, version.flagged_at)
                self.chart = ReviewChart(data, self.state, self._picked).classes("chart").props('data-mark="chart"')
                self.chart.on("drawn", self.overlay)
                self._editing()
            with ui.element("div").classes("stack"):
                self.judging = Judging(self)
        self.comparison = Comparison(self)
        self.refresh()

    def _tools(self) -> None:
        words = self.words
        three = self.version.material.path.points.shape[1] == 3

        def toggle(key: str, options: dict[str, str]) -> None:
            ui.toggle(options, value=self.state[key], on_change=lambda event: self._set(key, event.value)).props(
                "no-caps dense unelevated toggle-color=primary color=white text-color=dark"
            ).classes("framed").props(f'data-mark="toggle-{key}"')

        def switch(key: str, label: str) -> None:
            ui.checkbox(label, value=self.state[key], on_change=lambda event: self._set(key, event.value)).props(
                "dense"
            )

        with ui.element("div").classes("line"):
            toggle("view", {"path": words("x–y and x–z") if three else words("Path"), "time": words("Over time")})
            toggle("mode", {"aligned": words("Aligned"), "raw": words("As recorded")})
            switch("tube", words("Tube ±2σ"))
            switch("components", words("Components"))
        with ui.element("div").classes("line"):
            tools = {"point": "Point", "stretch": "Stretch", "box": "Box", "move": "Move"}
            toggle("tool", {key: words(label) for key, label in tools.items()})
            targets = {"one": words("of one demonstration"), "all": words("of all, along the path")}
            choose(targets, self.state["target"], lambda event: self._set("target", event.value)).props(
                'data-mark="target"'
            )
            ui.space()
            self.undo_button = self._tool("undo", words("Undo (U)"), self.undo)
            self.redo_button = self._tool("redo", words("Redo (Shift+U)"), self.redo)

    def _tool(self, icon: str, name: str, act: Callable[[], Any]) -> ui.button:
        button = ui.button(icon=icon, on_click=act).props(f'flat dense data-mark="{icon}" aria-label="{name}"')
        return button.tooltip(name)

    def _editing(self) -> None:
        words = self.words
        with ui.element("div").classes("line"):
            self.told = ui.label().classes("small").props('data-mark="draft"')
            ui.space()
            self.again = ui.button(words("Learn again"), on_click=self.learn_again).props("no-caps unelevated dense")
            self.again.props('data-mark="learn-again"').set_visibility(self.session.may("edit"))
        legend = (
            "Grey: demonstrations · orange: flagged, ▲ where · dotted: left out · blue: learned · ✕: struck · "
            "red dashes: where the path is expected to go · grey dashes: before"
        )
        ui.label(words(legend)).classes("small soft")

    def _set(self, key: str, value: Any) -> None:
        self.state[key] = value
        self.chart.show(**{key: value})
        if key == "mode":
            self.overlay()

    def _picked(self, picked: Mapping[str, Any]) -> None:
        """Somebody picked samples: of lines, or of the learned path (line -1)."""
        material = self.version.material
        names = list(material.raw)
        samples: dict[str, frozenset[int]] = {}
        for one in picked["ranges"]:
            line, first, last = int(one["line"]), int(one["from"]), int(one["to"])
            if line < 0:
                shown = self._path_samples()
                found = material.picked_everywhere(shown[first], shown[last])
            else:
                found = {names[line]: material.picked(names[line], first, last, picked["mode"])}
            for name, indices in found.items():
                samples[name] = samples.get(name, frozenset()) | indices
        self.version.draft.strike({name: one for name, one in samples.items() if name not in self.edits.excluded})
        self.refresh()

    def _path_samples(self) -> list[int]:
        return thinned(self.version.material.path)

    @property
    def edits(self) -> Edits:
        """The edits as they stand."""
        return self.version.draft.edits

    def refresh(self) -> None:
        """Show the edits as they stand: overlay, list, buttons and words."""
        draft, words = self.version.draft, self.words
        self.overlay()
        self.demonstrations.refresh()
        self.undo_button.set_enabled(draft.can_undo)
        self.redo_button.set_enabled(draft.can_redo)
        self.again.set_enabled(draft.changed and not self.busy)
        parts = []
        if draft.struck_count:
            parts.append(words.count(draft.struck_count, "sample struck", "samples struck"))
        if self.edits.excluded:
            parts.append(words.count(len(self.edits.excluded), "demonstration left out", "demonstrations left out"))
        state = words("not learned yet") if draft.changed else words("as learned")
        self.told.text = f"{' · '.join(parts) or words('Nothing is taken out')} ({state})"

    def overlay(self) -> None:
        """Send what lies over the lines; the lines themselves were sent once."""
        version, material = self.version, self.version.material
        struck: dict[str, list[int]] = {}
        for line, name in enumerate(material.raw):
            indices = self.edits.struck.get(name)
            if indices:
                raw = self.state["mode"] == "raw" or name not in material.samples
                struck[str(line)] = sorted(indices) if raw else instants_struck(material.samples[name], indices)
        preview = None
        if version.draft.changed:
            preview = packed_path(material.path, material.expected(version.draft.saved, self.edits))
        self.chart.overlay(
            struck=struck,
            excluded=sorted(self.edits.excluded),
            preview=preview,
            ghost=packed_path(self.ghost) if self.ghost else None,
        )

    def undo(self) -> None:
        """Take the last step back."""
        self.version.draft.undo()
        self.refresh()

    def redo(self) -> None:
        """Do it again."""
        self.version.draft.redo()
        self.refresh()

    async def compare(self, other: Skill) -> None:
        """Put another version beside the one shown."""
        await self.comparison.add(other)

    def say_change(self, told: str) -> None:
        """Say, or with nothing unsay, how far another path is from the one shown."""
        self.judging.change.text = told

    def include(self, name: str, wanted: bool) -> None:
        """Leave a recording out or take it in again."""
        self.version.draft.include(name, wanted)
        self.refresh()

    async def learn_again(self) -> None:
        """Have a new version learned from what is left, and show it beside the one before."""
        session, words, before = self.session, self.words, self.version
        self.busy = True
        self.again.disable()
        self.told.text = words("Learning …")
        learned: list[int] = []

        async def learn() -> None:
            job_id, state, new = await session.client.learn_again(self.name, before.skill.version, self.edits)
            if state not in ("Completed", "Failed", "Aborted"):
                report = await session.client.follow(job_id, limit=LEARNING_LIMIT)
                new = report.skill_version
                if report.state != "Completed":
                    self.frame.tell(
                        f"{words('Learning ended')}: {words(report.state)}. {words.said(report.message)}", bad=True
                    )
            if new:
                learned.append(new)

        done = await self.frame.asked(words("Learn again"), learn)
        self.busy = False
        if not done or not learned:
            self.refresh()
            return
        session.kept.pop(("draft", self.name, before.skill.version), None)
        self.ghost = before.material.path
        if await self.show(learned[0]):
            measured = largest_change(before.material.path, self.version.material.path)
            away, where = told_distance(self.version.skill, before.skill) or measured
            told = f"{words('Version')} {learned[0]}: {words('the path moved by at most')} {words.figures(mm(away))}"
            self.frame.tell(f"{told} ({words('at')} {percent(where)} {words('of the way')})")
            self.judging.tell_change(before.skill.version, away, where)

    async def _look(self) -> None:
        """Tell when somebody else changed this skill; show a changed state at once, a newer version when asked to."""
        fresh = [one.event for one in self.session.happenings if one.number > self.seen]
        if not fresh:
            return
        self.seen = self.session.happenings[0].number
        mine = [one for one in fresh if one.skill_name == self.name]
        if mine and not self.busy:
            await self.judging.changed_elsewhere()

    def _key(self, key: Any) -> None:
        if key.action.keydown and not key.action.repeat and key.key.name in ("u", "U"):
            self.redo() if key.modifiers.shift else self.undo()

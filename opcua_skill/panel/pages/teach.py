"""Teaching: draw on the plate, upload recordings, and have a skill learned from them."""

from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import quote

import numpy as np
from nicegui import ui

from models.demonstration import Demonstration
from opcua_skill.client import JobReport, LearningOptions
from opcua_skill.panel.formatting import mm, percent, seconds
from opcua_skill.panel.layout import Frame, choose, title
from opcua_skill.panel.pages.recorder import RecorderSheet
from opcua_skill.panel.pages.upload import UploadSheet
from opcua_skill.panel.plate import Plate
from opcua_skill.panel.strokes import PLATE_MM, NotADemonstration, drawn, free_name

LEARNING_LIMIT = 600.0
PRESETS = {"recommended": "recommended", "free": "anywhere, any size", "paper": "as published"}
TYPES = ["Gluing", "Sealing", "Painting", "Soldering", "Deburring", "Polishing"]


@dataclass
class Taught:
    """What somebody has shown so far; kept over a reload of the page, until it is learned or cleared."""

    recordings: list[Demonstration] = field(default_factory=list)
    left_out: set[str] = field(default_factory=set)
    discarded: tuple[list[Demonstration], set[str]] = field(default_factory=lambda: ([], set()))
    name: str = ""
    semantic_type: str = TYPES[0]
    preset: str = "recommended"

    @property
    def used(self) -> list[Demonstration]:
        """The recordings that are to be learned from."""
        return [one for one in self.recordings if one.demonstration_id not in self.left_out]

    def add(self, one: Demonstration) -> None:
        """Take a recording in, under a name of its own."""
        taken = [other.demonstration_id for other in self.recordings]
        if one.demonstration_id in taken or not one.demonstration_id:
            one = replace(one, demonstration_id=free_name(taken, one.demonstration_id or "recording"))
        self.recordings.append(one)


async def teach_page(frame: Frame) -> None:
    """Show the plate, what was drawn, uploaded or recorded, and the way to a skill."""
    TeachPage(frame)


class TeachPage:
    """The page as one browser sees it."""

    def __init__(self, frame: Frame) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        words = self.words
        taught = self.session.kept.setdefault("taught", Taught())
        assert isinstance(taught, Taught)
        self.taught = taught
        self.may = self.session.may("learn")
        self.busy = False
        if not self.may:
            ui.label(words("Teaching needs the role teacher.")).classes("sheet check-bad")
        with ui.element("div").classes("columns teach-columns"):
            with ui.element("div").classes("sheet stack"):
                with ui.element("div").classes("line"):
                    title(words("Draw on the plate"))
                    size = f"{PLATE_MM[0]:.0f} × {PLATE_MM[1]:.0f} mm"
                    told = words("Each stroke is one demonstration: show the same movement three times or more.")
                    ui.label(f"{size}. {told}").classes("small soft")
                self.plate = Plate(*PLATE_MM, drawing=self.may).props('data-mark="plate"')
                self.plate.on("stroke", self._stroke)
                self.plate.on(
                    "broken", lambda: frame.tell(words("the stroke was interrupted: draw it again"), bad=True)
                )
            with ui.element("div").classes("stack"):
                with ui.element("div").classes("sheet stack"):
                    self._list()
                with ui.element("div").classes("sheet stack"):
                    self._learning()
            with ui.element("div").classes("stack"):
                with ui.element("div").classes("sheet stack"):
                    self.recorder = RecorderSheet(frame, self.plate, self._ready)
                with ui.element("div").classes("sheet stack"):
                    self.upload = UploadSheet(frame, self._take, lambda: self.taught.recordings)
        self.show()
        ui.timer(0.3, self.show, once=True)

    def _list(self) -> None:
        words = self.words
        with ui.element("div").classes("line"):
            self.count = title("").props('data-mark="count"')
            ui.space()
            self.discard_all = ui.button(words("Discard all"), on_click=self._clear)
            self.discard_all.props('no-caps flat dense data-mark="discard-all"')
            self.bring_back = ui.button(words("Bring back"), icon="undo", on_click=self._bring_back)
            self.bring_back.props('no-caps outline dense data-mark="bring-back"')
        self.listed = ui.element("div").classes("stack").style("max-height:24vh;overflow:auto;gap:0")

    def _learning(self) -> None:
        words, taught = self.words, self.taught
        title(words("Learn a skill"))
        name = ui.input(words("Name of the skill")).props('dense outlined data-mark="skill-name"').classes("w-full")
        name.bind_value(taught, "name").on_value_change(self._ready)
        kind = ui.input(words("What kind of skill"), autocomplete=TYPES).props("dense outlined").classes("w-full")
        kind.bind_value(taught, "semantic_type")
        presets = {key: words(PRESETS[key]) if key in PRESETS else key for key in self.session.presets}
        how = choose(presets, taught.preset, label=words("How to learn")).classes("w-full")
        how.bind_value(taught, "preset")
        self.learn_button = ui.button(words("Learn"), on_click=self.learn).props("no-caps unelevated").classes("w-full")
        self.learn_button.props('data-mark="learn"')
        self.learn_recorded = ui.button(words("Learn from the recording"), on_click=self.learn_from_recording)
        self.learn_recorded.props('no-caps unelevated data-mark="learn-recorded"').classes("w-full")
        self.told = ui.label().classes("small soft").props('data-mark="told"')

    async def _stroke(self, event: Any) -> None:
        given = event.args
        name = free_name([one.demonstration_id for one in self.taught.recordings])
        try:
            stroke = drawn(name, self.session.user, given["t"], given["x"], given["y"])
        except NotADemonstration as wrong:
            self.frame.tell(self.words(str(wrong)), bad=True)
            self.show()
            return
        if self.recorder.feeds():
            await self.recorder.append(stroke)
        else:
            self.taught.add(stroke)
        self.show()

    def _take(self, found: Sequence[Demonstration]) -> None:
        for one in found:
            self.taught.add(one)
        self.show()

    def _clear(self) -> None:
        self.taught.discarded = (list(self.taught.recordings), set(self.taught.left_out))
        self.taught.recordings.clear()
        self.taught.left_out.clear()
        self.show()

    def _bring_back(self) -> None:
        """Take back what was discarded at once; what has been shown since stays."""
        recordings, left_out = self.taught.discarded
        since, self.taught.recordings[:] = list(self.taught.recordings), recordings
        self.taught.left_out |= left_out
        self.taught.discarded = ([], set())
        self._take(since)

    def _keep(self, name: str, used: bool) -> None:
        (self.taught.left_out.discard if used else self.taught.left_out.add)(name)
        self.show()

    def _remove(self, name: str) -> None:
        self.taught.recordings[:] = [one for one in self.taught.recordings if one.demonstration_id != name]
        self.taught.left_out.discard(name)
        self.show()

    @property
    def _options(self) -> LearningOptions:
        return LearningOptions(preset=self.taught.preset)  # type: ignore[arg-type]

    async def learn(self) -> None:
        """Have a skill learned from what was drawn and uploaded."""
        taught = self.taught

        async def begin() -> str:
            started = await self.session.client.learn(
                taught.name.strip(), taught.used, semantic_type=taught.semantic_type.strip(), options=self._options
            )
            return started.job_id

        if await self._follow(begin):
            taught.recordings.clear()
            taught.left_out.clear()
            taught.discarded = ([], set())

    async def learn_from_recording(self) -> None:
        """Have a skill learned from what a tracker has shown; the recording stays until it is discarded."""
        taught, recording = self.taught, self.recorder.learnable

        async def begin() -> str:
            started = await self.recorder.recorder.learn(
                recording, taught.name.strip(), taught.semantic_type.strip(), self._options
            )
            return started.job_id

        await self._follow(begin)

    async def _follow(self, begin: Callable[[], Awaitable[str]]) -> bool:
        """Start a learning job, tell how far it is, and show the skill it made; return whether it made one."""
        words, name = self.words, self.taught.name.strip()
        made: list[int] = []
        self.busy = True
        self._ready()
        self.told.text = words("Learning …")

        def tell_progress(one: JobReport) -> None:
            self.told.text = f"{words('Learning …')} {percent(one.progress)}"

        async def work() -> None:
            report = await self.session.client.follow(await begin(), limit=LEARNING_LIMIT, on_progress=tell_progress)
            if report.state == "Completed":
                made.append(report.skill_version)
            else:
                self.frame.tell(
                    f"{words('Learning ended')}: {words(report.state)}. {words.said(report.message)}", bad=True
                )

        await self.frame.asked(words("Learn"), work)
        self.busy = False
        if made:
            self.taught.name = ""
            with self.frame.client:
                ui.navigate.to(f"/skill/{quote(name, safe='')}?version={made[0]}")
        else:
            self.show()
        return bool(made)

    def _row(self, one: Demonstration) -> None:
        label, words = one.demonstration_id, self.words
        finite = one.points[np.isfinite(one.points).all(axis=1)]
        length = float(np.sqrt((np.diff(finite, axis=0) ** 2).sum(axis=1)).sum())
        with ui.element("div").classes("demo" + (" demo-excluded" if label in self.taught.left_out else "")):
            box = ui.checkbox(
                value=label not in self.taught.left_out, on_change=lambda event: self._keep(label, bool(event.value))
            )
            box.props("dense").props["aria-label"] = f"{words('use')} {label}"
            ui.label(label).classes("demo-name")
            with ui.element("div").classes("line").style("width:auto;flex-wrap:nowrap;gap:4px"):
                space = " · 3-D" if one.dimension == 3 else ""
                ui.label(words.figures(f"{mm(length, 0)} · {seconds(float(one.times[-1]))}{space}")).classes(
                    "small mono"
                )
                ui.button(icon="close", on_click=lambda: self._remove(label)).props("flat round").props[
                    "aria-label"
                ] = f"{words('Discard')} {label}"

    def show(self) -> None:
        """Show what there is to learn from."""
        taught = self.taught
        self.plate.show([(one, one.demonstration_id not in taught.left_out) for one in taught.recordings])
        self.count.text = self.words.count(len(taught.used), "demonstration", "demonstrations")
        self.discard_all.set_enabled(bool(taught.recordings))
        self.bring_back.set_visibility(bool(taught.discarded[0]))
        self.listed.clear()
        with self.listed:
            for one in taught.recordings:
                self._row(one)
        self.upload.refresh()
        self._ready()

    def _ready(self) -> None:
        """Say what is still needed, and offer to learn from what there is."""
        words, used = self.words, self.taught.used
        recorded = hasattr(self, "recorder") and bool(self.recorder.learnable)
        named = bool((self.taught.name or "").strip())
        missing = []
        if len(used) < 2:
            missing.append(words("two demonstrations or more"))
        if len({one.dimension for one in used}) > 1:
            missing.append(words("demonstrations of one kind: all in the plane or all in space"))
        if not named:
            missing.append(words("a name"))
        if not self.busy:
            needed = missing if not recorded or named else [words("a name")]
            done = not needed or (recorded and named)
            self.told.text = words("Ready to learn.") if done else f"{words('Still needed')}: {', '.join(needed)}"
        self.learn_button.set_enabled(self.may and not missing and not self.busy)
        self.learn_recorded.set_visibility(recorded)
        self.learn_recorded.set_enabled(self.may and named and not self.busy)

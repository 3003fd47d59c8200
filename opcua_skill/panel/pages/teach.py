"""Teaching: draw on the plate, upload recordings, and have a skill learned from them."""

import asyncio
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from nicegui import ui
from nicegui.element import Element
from nicegui.events import UploadEventArguments

from models.demonstration import Demonstration
from opcua_skill.client import JobReport, LearningOptions
from opcua_skill.panel.frame import Frame
from opcua_skill.panel.shown import mm, percent, seconds
from opcua_skill.panel.strokes import PLATE_MM, NotADemonstration, drawn, free_name

LEARNING_LIMIT = 600.0
MOST_POINTS = 400
TYPES = ["Gluing", "Sealing", "Painting", "Soldering", "Deburring", "Polishing"]


class Plate(Element, component=Path(__file__).parent.parent / "static" / "plate.js"):
    """The plate in the browser."""

    def __init__(self, width: float, height: float, *, drawing: bool) -> None:
        super().__init__()
        self._props.update(width=width, height=height, drawing=drawing)

    def show(self, recordings: "list[tuple[Demonstration, bool]]") -> None:
        """Draw recordings, and whether each is used."""
        strokes = []
        for one, used in recordings:
            step = max(1, len(one.times) // MOST_POINTS)
            points = np.round(1000.0 * one.points[::step, :2], 2)
            strokes.append(
                {
                    "id": one.demonstration_id,
                    "used": used,
                    "points": points.tolist(),
                }
            )
        self.run_method("show", strokes)


@dataclass
class Taught:
    """What somebody has shown so far; kept over a reload of the page, until it is learned or cleared."""

    recordings: list[Demonstration] = field(default_factory=list)
    left_out: set[str] = field(default_factory=set)
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
    """Show the plate, what was drawn or uploaded, and the way to a skill."""
    words, session = frame.words, frame.session
    taught = session.kept.setdefault("taught", Taught())
    assert isinstance(taught, Taught)
    may = session.may("learn")
    if not may:
        ui.label(words("Teaching needs the role teacher.")).classes("sheet check-bad")

    def stroke(event: Any) -> None:
        given = event.args
        name = free_name([one.demonstration_id for one in taught.recordings])
        try:
            taught.add(drawn(name, session.user, given["t"], given["x"], given["y"]))
        except NotADemonstration as wrong:
            frame.tell(words(str(wrong)), bad=True)
        show()

    async def upload(event: UploadEventArguments) -> None:
        from library.errors import ReaderError
        from opcua_skill.panel.uploads import read_upload

        content = await event.file.read()
        try:
            found = await asyncio.to_thread(read_upload, event.file.name, content)
        except ReaderError as wrong:
            frame.tell(str(wrong), bad=True)
            return
        for one in found:
            taught.add(one)
        frame.tell(f"{event.file.name}: {len(found)} {words('demonstrations')}")
        show()

    def clear() -> None:
        taught.recordings.clear()
        taught.left_out.clear()
        show()

    def keep(name: str, used: bool) -> None:
        (taught.left_out.discard if used else taught.left_out.add)(name)
        show()

    def remove(name: str) -> None:
        taught.recordings[:] = [one for one in taught.recordings if one.demonstration_id != name]
        taught.left_out.discard(name)
        show()

    def tell_progress(one: JobReport) -> None:
        told.text = f"{words('Learning …')} {percent(one.progress)}"

    async def learn() -> None:
        learning.disable()
        told.text = words("Learning …")

        async def work() -> None:
            client = session.client
            options = LearningOptions(preset=taught.preset)  # type: ignore[arg-type]
            started = await client.learn(
                taught.name.strip(), taught.used, semantic_type=taught.semantic_type.strip(), options=options
            )
            report = await client.follow(
                started.job_id,
                limit=LEARNING_LIMIT,
                on_progress=tell_progress,
            )
            if report.state == "Completed":
                name = taught.name.strip()
                clear()
                taught.name = ""
                with frame.client:
                    ui.navigate.to(f"/skill/{quote(name, safe='')}?version={report.skill_version}")
            else:
                frame.tell(f"{words('Learning ended')}: {words(report.state)}. {report.message}", bad=True)

        await frame.asked(words("Learn"), work)
        show()

    with ui.element("div").classes("columns wide-left"):
        with ui.element("div").classes("sheet stack"):
            with ui.element("div").classes("line"):
                ui.label(words("Draw on the plate")).classes("sheet-title")
                size = f"{PLATE_MM[0]:.0f} × {PLATE_MM[1]:.0f} mm"
                ui.label(
                    f"{size}. {words('Each stroke is one demonstration: show the same movement three times or more.')}"
                ).classes("small soft")
            plate = Plate(*PLATE_MM, drawing=may).props('data-mark="plate"')
            plate.on("stroke", stroke)
        with ui.element("div").classes("stack"):
            with ui.element("div").classes("sheet stack"):
                ui.label(words("Upload recordings")).classes("sheet-title")
                ui.upload(
                    label=words("CSV, motion capture, ROS bag … (drop here)"),
                    on_upload=upload,
                    multiple=True,
                    auto_upload=True,
                    max_file_size=200_000_000,
                ).props("flat bordered").classes("w-full").set_enabled(may)
            with ui.element("div").classes("sheet stack"):
                with ui.element("div").classes("line"):
                    count = ui.label().classes("sheet-title").props('data-mark="count"')
                    ui.space()
                    ui.button(words("Discard all"), on_click=clear).props("no-caps flat dense")
                listed = ui.element("div").classes("stack").style("max-height:24vh;overflow:auto;gap:0")
            with ui.element("div").classes("sheet stack"):
                ui.label(words("Learn a skill")).classes("sheet-title")
                name = (
                    ui.input(words("Name of the skill"))
                    .props("dense outlined")
                    .classes("w-full")
                    .props('data-mark="skill-name"')
                )
                name.bind_value(taught, "name")
                kind = (
                    ui.input(words("What kind of skill"), autocomplete=TYPES).props("dense outlined").classes("w-full")
                )
                kind.bind_value(taught, "semantic_type")
                ui.toggle({"recommended": words("recommended"), "paper": words("as published")}).props(
                    "no-caps dense unelevated toggle-color=primary color=white text-color=dark"
                ).classes("border rounded").bind_value(taught, "preset")
                learning = ui.button(words("Learn"), on_click=learn).props("no-caps unelevated").classes("w-full")
                learning.props('data-mark="learn"')
                told = ui.label().classes("small soft").props('data-mark="told"')

    def row(one: Demonstration) -> None:
        label = one.demonstration_id
        finite = one.points[np.isfinite(one.points).all(axis=1)]
        length = float(np.sqrt((np.diff(finite, axis=0) ** 2).sum(axis=1)).sum())
        with ui.element("div").classes("demo" + (" demo-excluded" if label in taught.left_out else "")):
            box = ui.checkbox(
                value=label not in taught.left_out, on_change=lambda event: keep(label, bool(event.value))
            )
            box.props("dense").props["aria-label"] = f"{words('use')} {label}"
            ui.label(label).classes("demo-name")
            with ui.element("div").classes("line").style("width:auto;flex-wrap:nowrap;gap:4px"):
                ui.label(f"{mm(length, 0)} · {seconds(float(one.times[-1]))}").classes("small mono")
                ui.button(icon="close", on_click=lambda: remove(label)).props("flat dense round size=xs")

    def show() -> None:
        used = taught.used
        plate.show([(one, one.demonstration_id not in taught.left_out) for one in taught.recordings])
        count.text = f"{len(used)} {words('demonstrations')}"
        listed.clear()
        with listed:
            for one in taught.recordings:
                row(one)
        ready()

    def ready() -> None:
        missing = []
        if len(taught.used) < 2:
            missing.append(words("two demonstrations or more"))
        if len({one.dimension for one in taught.used}) > 1:
            missing.append(words("demonstrations of one kind: all in the plane or all in space"))
        if not (taught.name or "").strip():
            missing.append(words("a name"))
        told.text = f"{words('Still needed')}: {', '.join(missing)}" if missing else words("Ready to learn.")
        learning.set_enabled(may and not missing)

    name.on_value_change(ready)
    show()
    ui.timer(0.3, show, once=True)

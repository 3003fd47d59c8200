"""Uploading recordings: what a file leaves open is asked for; what is wrong with it is told with line and remedy."""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import replace

from nicegui import ui
from nicegui.events import MultiUploadEventArguments

from library.errors import ChoiceNeeded, LibraryError, ReaderError
from library.readers import Choices, common_plane, onto_plane
from models.demonstration import Demonstration
from opcua_skill.panel.formatting import mm
from opcua_skill.panel.layout import Frame, choose, title
from opcua_skill.panel.uploads import LARGEST, uploaded

UNITS = ("", "mm", "cm", "m")
AXES = ("", "x", "y", "z")
ASKED = {
    "marker": "Marker or body",
    "up_axis": "Axis that points up",
    "unit": "Unit of the positions",
    "topic": "Topic",
}


class UploadSheet:
    """The sheet on the teach page. ``take`` gets what was read; ``taken`` are the recordings there are."""

    def __init__(
        self, frame: Frame, take: Callable[[Sequence[Demonstration]], None], taken: Callable[[], list[Demonstration]]
    ) -> None:
        self.frame, self.words, self.take, self.taken = frame, frame.words, take, taken
        self.refusals: dict[str, str] = {}
        words = self.words
        title(words("Upload recordings"))
        may = frame.session.may("learn")
        self.chooser = ui.upload(
            label=words("CSV, motion capture, ROS bag … (drop here)"),
            on_multi_upload=self._given,
            multiple=True,
            auto_upload=True,
            max_file_size=LARGEST,
            on_rejected=lambda: self._refused(words("A file"), words("it is larger than 200 MB, or of no kind known")),
        )
        # one request, so that the order is that of the choice
        self.chooser.props('flat bordered batch data-mark="upload"').classes("w-full").set_enabled(may)
        self.files = ui.element("div").classes("stack").style("gap: 0").props('data-mark="files" role=status')
        with ui.element("div").classes("line"):
            told = words("as in the file")
            self.unit = choose({one: one or told for one in UNITS}, "", label=words("Unit")).classes("half")
            self.up = choose({one: one or told for one in AXES}, "", label=words("Up is")).classes("half")
        self.wrong = ui.label().classes("check-bad small lines").props('data-mark="upload-refusal" role=alert')
        self.asking = ui.element("div").classes("stack").props('data-mark="upload-choice"')
        self.flat = ui.button(words("Lay into their plane (2-D)"), icon="layers", on_click=self._flatten)
        self.flat.props('no-caps outline dense data-mark="flatten"')
        self.refresh()

    def refresh(self) -> None:
        """Offer the plane while there are recordings in space."""
        self.flat.set_visibility(any(one.dimension == 3 for one in self.taken()))

    async def _given(self, event: MultiUploadEventArguments) -> None:
        """Read files one after another, in the order in which they were chosen."""
        self.chooser.reset()  # its own list would give a tick to whatever arrived, also to what cannot be read
        self.files.clear()
        choices = Choices(unit=self.unit.value or "", up_axis=self.up.value or "")
        for file in event.files:
            self._refused(file.name, "")
            await self._read(file.name, await file.read(), choices)

    def _file(self, sign: str, told: str) -> None:
        """Add a line to the list of what became of the files."""
        with self.files:
            ui.label(f"{sign} {told}").classes("small lines " + ("check-good" if sign == "✓" else "check-bad"))

    async def _read(self, name: str, content: bytes, choices: Choices) -> None:
        try:
            found, gaps = await asyncio.to_thread(uploaded, name, content, choices)
        except ChoiceNeeded as needed:
            self._ask(name, content, choices, needed)
            return
        except ReaderError as wrong:
            self._refused(name, self.words.said(wrong))
            self._file("✕", f"{name}: {self.words('not taken')}")
            return
        self.take(found)
        self._file("✓", f"{name}: {self.words.count(len(found), 'demonstration', 'demonstrations')}")
        for gap in gaps:
            self._file("⚠", self.words.said(gap))
        self.refresh()

    def _refused(self, name: str, sentence: str) -> None:
        """Show what is wrong with each file, until it is given again: the next file does not wipe it out."""
        self.refusals.pop(name, None)
        if sentence:
            self.refusals[name] = sentence
        self.wrong.text = "\n".join(f"✕ {one}" for one in self.refusals.values())

    def _ask(self, name: str, content: bytes, choices: Choices, needed: ChoiceNeeded) -> None:
        """Ask in place for what a file leaves open; other files can be chosen meanwhile."""
        words = self.words
        with self.asking, ui.element("div").classes("asked") as asked:
            ui.label(f"? {words.said(needed)}").classes("small")

            async def chosen(value: str) -> None:
                asked.delete()
                await self._read(name, content, replace(choices, **{needed.choice: value}))

            label = words(ASKED.get(needed.choice, needed.choice))
            if needed.options:
                options = {one: one for one in needed.options}
                choose(options, None, lambda event: chosen(event.value), label).props('data-mark="choice"')
            else:
                typed = ui.input(label).props("dense outlined")
                ui.button(words("Read it"), on_click=lambda: chosen(typed.value or "")).props("no-caps outline dense")
            ui.button(words("Leave this file out"), on_click=asked.delete).props("no-caps flat dense")

    def _flatten(self) -> None:
        """Turn recordings in space into recordings in the one plane that is nearest to all of them."""
        words, recordings = self.words, self.taken()
        in_space = [one for one in recordings if one.dimension == 3]
        try:
            plane = common_plane(in_space)
            laid = iter(onto_plane(in_space, plane))
        except LibraryError as wrong:
            self._refused("", words.said(wrong))
            return
        self._refused("", "")
        recordings[:] = [next(laid) if one.dimension == 3 else one for one in recordings]
        self.frame.tell(
            f"{words('Laid into their plane; they were away from it by')} {words.figures(mm(plane.deviation))} (RMS)"
        )
        self.take([])
        self.refresh()

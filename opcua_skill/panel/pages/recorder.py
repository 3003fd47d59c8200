"""The workstation's recorder, live: what a tracker sends is drawn as it comes; finish, discard, learn from it."""

import asyncio
import contextlib
from collections.abc import Callable

import numpy as np
from nicegui import ui

from models.demonstration import Demonstration
from opcua_skill.client import ClientError
from opcua_skill.client.recorder import Presses, Recorder, RecorderState
from opcua_skill.panel.layout import Frame, title
from opcua_skill.panel.plate import Plate
from opcua_skill.panel.strokes import appended

AGAIN = 1.0
AT_LEAST_EVERY = 2.0
WATCHED = ("Recording", "Trigger", "RecordingId", "Samples", "DemonstrationCount")


class RecorderSheet:
    """The sheet on the teach page. ``changed`` is called when what is recorded has changed."""

    def __init__(self, frame: Frame, plate: Plate, changed: Callable[[], None]) -> None:
        self.frame, self.words, self.session, self.plate = frame, frame.words, frame.session, plate
        self.station = self.session.station_name
        self.changed = changed
        self.mine = ""
        self.clock = 0.0
        self.state: RecorderState | None = None
        self.shown: tuple[str, int] = ("", 0)
        self.presses: Presses | None = None
        self.rows: tuple[tuple[str, ...], str] = ((), "")
        self.counts: list[ui.label] = []
        words = self.words
        with ui.element("div").classes("line"):
            title(f"{words('Tracker at')} {self.station}")
            ui.space()
            self.sign = ui.label().classes("small").props('data-mark="recorder-state"')
        self.told = ui.label().classes("small soft").props('data-mark="recorder-told"')
        self.listed = ui.element("div").classes("stack").style("gap: 0; max-height: 20vh; overflow: auto")
        self.listed.props('data-mark="recorded"')
        with ui.element("div").classes("line"):
            self.start_button = ui.button(words("Record what I draw"), icon="fiber_manual_record", on_click=self.start)
            self.start_button.props('no-caps outline dense data-mark="record-start"')
            self.finish_button = ui.button(words("Finish"), icon="stop", on_click=self.finish)
            self.finish_button.props('no-caps outline dense data-mark="record-finish"')
            self.discard_button = ui.button(
                words("Discard all"), icon="delete", on_click=lambda: self.sure.set_visibility(True)
            )
            self.discard_button.props('no-caps flat dense data-mark="record-discard"')
        with ui.element("div").classes("asked line") as self.sure:
            ui.label(words("Discard this recording for good? It cannot be brought back."))
            yes = ui.button(words("Yes, discard"), on_click=self._discard_all)
            yes.props('no-caps outline color=negative data-mark="record-discard-yes"')
            ui.button(words("No"), on_click=lambda: self.sure.set_visibility(False)).props("no-caps flat")
        self.sure.set_visibility(False)
        following = asyncio.create_task(self._follow(), name=f"panel follows the recorder of {self.station}")
        frame.client.on_delete(lambda: following.cancel())

    @property
    def recorder(self) -> Recorder:
        """The recorder, on the connection that there is now."""
        return self.session.client.workstation(self.station).recorder

    @property
    def learnable(self) -> str:
        """The recording a skill could be learned from: closed, with two demonstrations or more."""
        state = self.state
        good = state is not None and not state.recording and state.demonstrations >= 2
        return state.recording_id if good and state is not None else ""

    async def _follow(self) -> None:
        """Show what comes in, as long as the page is open; a lost connection is waited for."""
        while True:
            try:
                async with self.session.client.session.changes(
                    *(f"Machines/{self.station}/Recorder/{name}" for name in WATCHED)
                ) as changed:
                    while self.session.connected:
                        changed.clear()
                        await self._look()
                        with contextlib.suppress(TimeoutError):
                            async with asyncio.timeout(AT_LEAST_EVERY):
                                await changed.wait()
            except ClientError:
                self.shown = ("", 0)
            await asyncio.sleep(AGAIN)

    async def _look(self) -> None:
        recorder = self.recorder
        state = await recorder.state()
        known_id, known = self.shown
        if state.recording_id and (state.recording_id != known_id or state.samples != known):
            after = known if state.recording_id == known_id else 0
            view = await recorder.recording(state.recording_id, after)
            with self.frame.client:
                self.plate.track(view.positions, view.triggers, begin=after == 0)
            self.shown = (state.recording_id, view.samples)
        elif not state.recording_id and known_id:
            with self.frame.client:
                self.plate.track(np.zeros((0, 2)), np.zeros(0, dtype=bool), begin=True)
            self.shown = ("", 0)
        self.presses = await recorder.presses(state.recording_id) if state.recording_id else None
        if (shown := self.presses) is not None:
            with self.frame.client:
                self.plate.presses(list(zip(shown.first, shown.last, strict=True)))
        before, self.state = self.state, state
        if state != before:
            with self.frame.client:
                self.refresh()

    def refresh(self) -> None:
        """Say what the recorder does, and offer what can be done."""
        words, state = self.words, self.state
        recording = state is not None and state.recording
        pressed = state is not None and recording and state.trigger
        self.sign.text = f"● {words('recording')}" if recording else f"○ {words('nothing is being recorded')}"
        self.sign.classes("state-bad") if recording else self.sign.classes(remove="state-bad")
        parts = []
        if state is not None and state.recording_id:
            parts = [
                words.count(state.samples, "sample", "samples"),
                words.count(state.demonstrations, "demonstration", "demonstrations"),
            ]
            if recording:
                parts.append(words("button pressed") if pressed else words("button released"))
            if state.ignored:
                parts.append(words.count(state.ignored, "press was too short", "presses were too short"))
        self.told.text = " · ".join(parts) or words("A gateway (opcua-skill record) or this panel can feed it.")
        may = self.session.may("record")
        self.start_button.set_visibility(may and not recording)
        self.finish_button.set_visibility(may and recording)
        self.discard_button.set_visibility(may and state is not None and bool(state.recording_id))
        self._list()
        self.changed()

    def _list(self) -> None:
        """List the presses. Rows are made anew only when there are others: no press of a button is lost meanwhile."""
        presses = self.presses
        names = tuple(presses.ids) if presses is not None else ()
        going_on = names[-1] if presses is not None and presses.goes_on and names else ""
        if (names, going_on) != self.rows:
            self.rows, self.counts = (names, going_on), []
            self.listed.clear()
            with self.listed:
                for name in names:
                    self._row(name, name == going_on)
        if presses is not None:
            for label, first, last in zip(self.counts, presses.first, presses.last, strict=True):
                label.text = self.words.count(last - first + 1, "sample", "samples")

    def _row(self, name: str, goes_on: bool) -> None:
        with ui.element("div").classes("line queued"):
            ui.label(f"{'● ' if goes_on else ''}{name}").classes("small")
            self.counts.append(ui.label().classes("small soft"))
            ui.space()
            if not goes_on and self.session.may("record"):
                ui.button(icon="close", on_click=lambda: self.discard(name)).props("flat round").props["aria-label"] = (
                    f"{self.words('Discard')} {name}"
                )

    async def start(self) -> None:
        """Begin a recording that what is drawn on this page feeds; every panel sees it."""

        async def begin() -> None:
            self.mine = await self.recorder.start(2, self.session.user, "drawn at the panel")
            self.clock = 0.0

        await self.frame.asked(self.words("Record what I draw"), begin)

    def feeds(self) -> bool:
        """Whether strokes drawn here go to the recorder."""
        return (
            bool(self.mine) and self.state is not None and self.state.recording and self.state.recording_id == self.mine
        )

    async def append(self, stroke: Demonstration) -> None:
        """Send a stroke: the button is pressed while it lasts, and released after it."""
        times, points, pressed = appended(stroke, self.clock)

        async def send() -> None:
            await self.recorder.append(self.mine, times, points, pressed)
            self.clock = float(times[-1])

        await self.frame.asked(self.words("Record what I draw"), send)

    async def finish(self) -> None:
        """End the recording, whoever feeds it."""
        if (state := self.state) is not None:
            await self.frame.asked(self.words("Finish"), lambda: self.recorder.finish(state.recording_id))

    async def _discard_all(self) -> None:
        self.sure.set_visibility(False)
        await self.discard("")

    async def discard(self, name: str) -> None:
        """Forget one demonstration, or the whole recording."""
        if (state := self.state) is not None and state.recording_id:
            word = self.words("Discard")
            await self.frame.asked(word, lambda: self.recorder.discard(state.recording_id, name))

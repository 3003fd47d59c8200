"""The workstation's queue: held by what, by whom and since when; released by a person who has seen what begins then."""

from nicegui import ui

from opcua_skill.client import JobReport, QueueStatus
from opcua_skill.panel.layout import Frame, stopped
from opcua_skill.panel.modes import mode_tag, moves

BECAUSE = {
    "Aborted": "a job was aborted",
    "Stopped": "motion was stopped",
    "ProtectiveStop": "protective stop",
    "Failed": "a job failed",
    "ArmLost": "contact with the arm was lost",
    "UnaskedStop": "the arm stopped by itself, or stands where no job left it",
    "UnaskedPause": "paused at the arm itself, not from here",
    "UnfinishedAtStart": "something was unfinished when the server ended",
    "Requested": "somebody asked for it",
}
OURS = ("arm", "server")  # every other one is a user, whose name is nobody's to translate
STEPS = (
    "Nothing begins until somebody releases the queue. Before that: reset the arm if it waits for it, and send it to "
    "the start (below, at the arm)."
)


class HeldQueue:
    """The part of the motion sheet; `refresh` shows what the session knows."""

    def __init__(self, frame: Frame) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        self.waiting: list[JobReport] = []
        words = self.words
        with ui.element("div").classes("held stack").props('data-mark="held" role=status') as self.box:
            self.told = ui.label().classes("sheet-title")
            self.steps = ui.label(words(STEPS)).classes("small")
            self.release = ui.button(words("Release the queue"), icon="lock_open", on_click=self._pressed)
            self.release.props('no-caps unelevated data-mark="release-queue"')
            self.why = ui.label().classes("small check-bad").props('data-mark="why-release"')
        self.box.set_visibility(False)
        self.sure = ui.element("div").classes("asked stack").props('data-mark="sure-release" role=group')
        self.sure.set_visibility(False)
        with ui.element("div").classes("line"):
            self.hold = ui.button(words("Hold the queue"), icon="back_hand", on_click=self._hold)
            self.hold.props('no-caps flat dense data-mark="hold-queue"')

    def refresh(self, waiting: list[JobReport]) -> None:
        """Show whether the queue is held, why, by whom, since when."""
        session, queue = self.session, self.session.station.queue
        self.waiting = [one for one in waiting if moves(one)]
        held = queue is not None and queue.held
        self.box.set_visibility(held)
        self.hold.set_visibility(not held)
        self.hold.set_enabled(session.live and session.may("release"))
        if queue is None or not held:
            self.sure.set_visibility(False)
            return
        self.told.text = self._said(queue)
        reason = self._why_not()
        self.why.text = reason
        self.release.set_enabled(not reason)
        if reason:
            self.sure.set_visibility(False)

    def _said(self, queue: QueueStatus) -> str:
        words = self.words
        since = f", {words('since')} {queue.since.astimezone():%Y-%m-%d %H:%M:%S}" if queue.since else ""
        who = f", {words('by')} {words(queue.by) if queue.by in OURS else queue.by}" if queue.by else ""
        waiting = f" {queue.waiting} {words('waiting')}." if queue.waiting else ""
        return f"■ {words('QUEUE HELD')}: {words(BECAUSE.get(queue.because, queue.because))}{who}{since}.{waiting}"

    def _why_not(self) -> str:
        words, session, station = self.words, self.session, self.session.station
        if not session.live or station.arm is None:
            return words("no connection, or the server does not answer")
        if not session.may("release"):
            return words("needs the role operator")
        if stopped(station):
            return words("the arm waits for a reset")
        if any(moves(one) and one.state != "Queued" for one in station.active) or not station.arm.at_rest:
            return words("something moves, or is under way here")
        if station.lock is not None and station.lock.locked and not session.has_lock(station.name):
            return f"{words('This arm is kept by')} {station.lock.user}"
        return ""

    async def _pressed(self) -> None:
        """Release at once what holds nothing back; ask first where a run would begin by it."""
        if not self.waiting:
            await self._release()
            return
        words, first = self.words, self.waiting[0]
        self.sure.clear()
        self.sure.set_visibility(True)
        begins = words("When the queue is released, this begins at once")
        with self.sure:
            ui.label(f"{len(self.waiting)} {words('waiting')}. {begins}:")
            ui.html(mode_tag(words, first.mode), sanitize=False)
            ui.label(f"{first.skill_name} {first.skill_version} · {first.recipe_id}").classes("sheet-title")
            with ui.element("div").classes("line"):
                yes = ui.button(words("Yes, release: it begins"), on_click=self._release)
                yes.props('no-caps unelevated color=negative data-mark="yes-release"')
                ui.button(words("No"), on_click=lambda: self.sure.set_visibility(False)).props("no-caps outline")

    async def _release(self) -> None:
        self.sure.set_visibility(False)
        await self._ask(self.words("Release the queue"), release=True)

    async def _hold(self) -> None:
        await self._ask(self.words("Hold the queue"), release=False)

    async def _ask(self, doing: str, *, release: bool) -> None:
        workstation = self.session.client.workstation(self.session.station_name)
        comment = f"{self.session.user} at the panel"
        ask = workstation.release_queue if release else workstation.hold_queue
        await self.frame.asked(doing, lambda: ask(comment))
        self.session.look_again()

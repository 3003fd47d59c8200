"""The arm as it is now: what it does, where it is, who has it for themselves, and the way back after a stop."""

import math

from nicegui import ui

from opcua_skill.client import ClientError
from opcua_skill.panel.layout import Frame, arm_words, stopped, title
from opcua_skill.panel.modes import moves

OURS = "You have this arm for yourself: nobody else can move it."
ACKNOWLEDGE = (
    "The arm stopped and waits. Look why, then reset: that moves nothing. After that, send it to the start: it never "
    "goes there by itself."
)
HOMING = "the arm moves slowly to where every run begins. See that its way is free."
FREE = "Nobody has this arm for themselves: whoever may, can run it."


class ArmSheet:
    """The sheet on the run page; `refresh` shows what the session knows."""

    def __init__(self, frame: Frame) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        words = self.words
        with ui.element("div").classes("line"):
            title(words("Arm"))
            ui.space()
            self.mode = ui.label().classes("small")
        self.tool = ui.label().classes("small mono").props('data-mark="tool"')
        self.joints = ui.label().classes("small mono soft").props('data-mark="joints"')
        self.lock = ui.label().classes("small").props('data-mark="lock"')
        with ui.element("div").classes("line"):
            self.take = ui.button(words("Take it for me"), icon="lock", on_click=self._take)
            self.take.props('no-caps outline dense data-mark="take-lock"')
            self.give = ui.button(words("Give it back"), icon="lock_open", on_click=self._give)
            self.give.props('no-caps outline dense data-mark="give-lock"')
            self.broken = ui.button(words("Take it away from them"), icon="lock_open", on_click=self._break)
            self.broken.props('no-caps flat dense color=negative data-mark="break-lock"')
        self.told = ui.label().classes("small").props('data-mark="arm-told"')
        with ui.element("div").classes("line"):
            self.reset = ui.button(words("Reset"), icon="restart_alt", on_click=self._reset)
            self.reset.props('no-caps outline dense data-mark="reset-arm"')
            self.home = ui.button(words("Go to the start"), icon="home", on_click=self._go_home)
            self.home.props('no-caps outline dense data-mark="home"')

    def refresh(self) -> None:
        """Show arm and lock."""
        session, words, station = self.session, self.words, self.session.station
        arm, lock = station.arm, station.lock
        self.mode.text = arm_words(words, station)
        if arm is not None:
            x, y, z = (round(1000.0 * value, 1) + 0.0 for value in arm.tool_pose[:3])
            self.tool.text = f"{words('nozzle')} {words.figures(f'x {x:.1f}  y {y:.1f}  z {z:.1f} mm')}"
            self.joints.text = f"{words('joints')} {'  '.join(f'{math.degrees(one):.0f}' for one in arm.position)} °"
        mine = session.has_lock(session.station_name)
        others = lock is not None and lock.locked and not mine
        if mine:
            self.lock.text = f"● {words(OURS)}"
        elif others and lock is not None:
            self.lock.text = f"■ {words('This arm is kept by')} {lock.user} ({lock.client})"
        else:
            self.lock.text = f"○ {words(FREE)}"
        self.take.set_visibility(session.may("lock") and not mine and not others)
        self.give.set_visibility(mine)
        self.broken.set_visibility(others and session.may("break lock"))
        halted = stopped(station)
        self.reset.set_visibility(halted)
        self.reset.set_enabled(session.live and session.may("reset"))
        why = self._why_not_home()
        self.home.set_enabled(not why)
        self.told.text = words(ACKNOWLEDGE) if halted else f"{words('Go to the start')}: {why or words(HOMING)}"
        for button in (self.take, self.give, self.broken):
            button.set_enabled(session.live)

    def _why_not_home(self) -> str:
        session, words, station = self.session, self.words, self.session.station
        if not session.live or station.arm is None:
            return words("no connection, or the server does not answer")
        if not session.may("run"):
            return words("needs the role operator")
        if any(moves(one) and one.state != "Queued" for one in station.active):
            return words("something moves, or is under way here")
        if station.lock is not None and station.lock.locked and not session.has_lock(station.name):
            return f"{words('This arm is kept by')} {station.lock.user}"
        return "" if station.arm.mode == "idle" else words("the arm is not at rest")

    async def _take(self) -> None:
        words, session = self.words, self.session

        async def take() -> None:
            if not await session.take_lock(session.station_name):
                raise ClientError(words("somebody else was faster"))

        await self.frame.asked(words("Take it for me"), take)

    async def _give(self) -> None:
        session = self.session
        await self.frame.asked(self.words("Give it back"), lambda: session.give_lock_back(session.station_name))

    async def _break(self) -> None:
        workstation = self.session.client.workstation(self.session.station_name)
        await self.frame.asked(self.words("Take it away from them"), workstation.break_lock)
        self.session.look_again()

    async def _reset(self) -> None:
        """Acknowledge what stopped the arm; nothing moves by it."""
        session = self.session
        workstation = session.client.workstation(session.station_name)
        if await self.frame.asked(self.words("Reset"), lambda: workstation.reset(f"{session.user} at the panel")):
            session.kept["stop told"] = ""
        session.look_again()

    async def _go_home(self) -> None:
        """Have the arm go slowly to where every run starts."""
        session = self.session
        workstation = session.client.workstation(session.station_name)
        comment = f"{session.user} at the panel"
        await self.frame.asked(self.words("Go to the start"), lambda: workstation.go_home(comment))
        session.look_again()

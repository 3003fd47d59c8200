"""The arm as it is now: what it does, where it is, who has it for themselves, and the way back after a stop."""

import math

from nicegui import ui

from opcua_skill.client import ClientError
from opcua_skill.panel.frame import Frame, arm_words, stopped

OURS = "You have this arm for yourself: nobody else can move it."
FREE = "Nobody has this arm for themselves: whoever may, can run it."


class ArmSheet:
    """The sheet on the run page; `refresh` shows what the session knows."""

    def __init__(self, frame: Frame) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        words = self.words
        with ui.element("div").classes("line"):
            ui.label(words("Arm")).classes("sheet-title")
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
            self.reset = ui.button(words("Reset and go to the start"), icon="restart_alt", on_click=self._reset)
            self.reset.props('no-caps outline dense data-mark="reset-home"')

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
        self.reset.set_visibility(stopped(station) and session.may("reset"))

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
        """Acknowledge a stop and have the arm go slowly to where every run starts."""
        session, workstation = self.session, self.session.client.workstation(self.session.station_name)
        comment = f"{session.user} at the panel"

        async def reset_and_go() -> None:
            await workstation.reset(comment)
            await workstation.go_home(comment)

        if await self.frame.asked(self.words("Reset and go to the start"), reset_and_go):
            session.kept["stop told"] = ""
        session.look_again()

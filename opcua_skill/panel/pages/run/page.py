"""Running: simulate, run on the arm, slow down, pause, go on, watch; live and replay never look alike."""

from urllib.parse import quote

from nicegui import ui

from opcua_skill.client import ClientError, JobReport, JobTrace, JointTrace, Mode
from opcua_skill.panel.formatting import moment
from opcua_skill.panel.layout import Frame, title
from opcua_skill.panel.modes import moves
from opcua_skill.panel.pages.card import CardSheet
from opcua_skill.panel.pages.run.arm import ArmSheet
from opcua_skill.panel.pages.run.jobs import JobTable
from opcua_skill.panel.pages.run.motion import MotionSheet
from opcua_skill.panel.pages.run.ordering import OrderSheet
from opcua_skill.panel.player import Player, in_base, trace_csv

VIEWS = {"paths": "From above and the side", "space": "In space", "time": "Over time"}


async def run_page(frame: Frame, skill: str = "", version: str = "0", recipe: str = "") -> None:
    """Show the workstation that is looked at; what somebody wants to try is named in the address."""
    page = RunPage(frame)
    await page.open(skill, recipe, int(version) if version.isdigit() else 0)


class RunPage:
    """The page as one browser sees it."""

    def __init__(self, frame: Frame) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        self.simulating = ""
        self.shown_jobs: tuple[JobReport, ...] | None = None
        self.was_moving = False
        self.was_live = True
        self.shown_joints: list[float] = []
        self.station = self.session.station_name

    async def open(self, skill: str, recipe: str, version: int) -> None:
        """Build the page."""
        with ui.element("div").classes("columns run-columns"):
            left = ui.element("div").classes("stack")
            with ui.element("div").classes("stack"):
                with ui.element("div").classes("sheet stack"):
                    self._view()
                with ui.element("div").classes("sheet stack"):
                    card = CardSheet(self.frame, self.words("What this run would do"))
                with ui.element("div").classes("sheet stack"):
                    title(self.words("Jobs here"))
                    with ui.element("div").classes("scrolls").props("tabindex=0"):
                        self.jobs = JobTable(self.frame, self.show_trace, self.download)
        with left:
            with ui.element("div").classes("sheet stack"):
                self.order = OrderSheet(self.frame, self.station, card, self.show_plan, self.begun)
            with ui.element("div").classes("sheet stack"):
                self.motion = MotionSheet(self.frame)
            with ui.element("div").classes("sheet stack"):
                self.arm_sheet = ArmSheet(self.frame)
        self.frame.on_refresh(self.refresh)  # at once: reading below takes its time
        # the page is there before the server has checked what was chosen: planning takes its time
        ui.timer(0.05, lambda: self.order.read(skill, recipe, version), once=True)
        ui.timer(0.5, self.order.look)

    def _view(self) -> None:
        words = self.words
        with ui.element("div").classes("line"):
            toggle = ui.toggle({key: words(label) for key, label in VIEWS.items()}, value="paths")
            toggle.props("no-caps unelevated toggle-color=primary color=white text-color=dark").classes("framed")
            toggle.props('data-mark="view"').on_value_change(lambda event: self.player.view(event.value))
            self.live = ui.label().classes("small").props('data-mark="view-state"')
        self.player = Player(words, "max(300px, calc(100vh - 400px))").classes("w-full").props('data-mark="player"')
        self.player.on("drawn", self.drawn)
        legend = (
            "Grey dashes: planned · orange dots: the arm as it moves · in a replay blue: commanded, "
            "violet: measured or simulated"
        )
        ui.label(words(legend)).classes("small soft")

    async def drawn(self) -> None:
        """Show the arm and the plan as soon as the browser can draw them."""

        async def read() -> None:
            self.player.arm(await self.session.client.workstation(self.station).links())

        if await self.frame.asked(self.words("Read the arm's links"), read):
            self.shown_joints = []
        await self.show_plan()

    async def show_plan(self) -> None:
        """Show where the nozzle would go with the chosen recipe."""
        recipe, check = self.order.chosen_recipe, self.order.card.check
        if recipe is None or check is None:
            return
        try:
            path = await self.session.client.path(recipe.skill_name, check.version)
        except ClientError as error:
            self.order.refusal.text = f"✕ {self.words.said(error)}"
            return
        self.player.plan(in_base(path, recipe))

    def begun(self, job_id: str, mode: Mode) -> None:
        """A run was asked for here: what was shown of an earlier one goes."""
        self.simulating = job_id if mode == "simulation" else ""
        self.player.begin()

    def refresh(self) -> None:
        """Show what the session knows of job, arm and jobs."""
        session, words = self.session, self.words
        if session.station_name != self.station:
            self.station, self.shown_jobs = session.station_name, None
            ui.navigate.to(f"/run?skill={quote(self.order.skill.value or '')}")
            return
        self.order.refresh()
        self.motion.refresh()
        self.arm_sheet.refresh()
        moving = [one for one in session.station.active if moves(one) and one.state != "Queued"]
        arm = session.station.arm
        if self.was_live and not session.live:
            self.player.begin()  # a nozzle that is no more where it is drawn would be a lie
        self.was_live = session.live
        if not session.live or arm is None:
            self.live.text = f"○ {words('nobody knows where the arm is')}"
        else:
            self.live.text = f"● {words('LIVE')} {self.station}" if moving else f"○ {words('nothing runs on the arm')}"
            if not self.was_moving and moving:
                self.player.begin()
            self._show_arm(bool(moving))
        self.was_moving = bool(moving)
        if session.station.jobs != self.shown_jobs:
            self._show_jobs(session.station.jobs)

    def _show_arm(self, moving: bool) -> None:
        arm = self.session.station.arm
        assert arm is not None
        joints = arm.position.round(4).tolist()
        if joints != self.shown_joints:
            self.shown_joints = joints
            self.player.pose(arm.position)
        if moving:
            self.player.live(arm.tool_pose[:3])

    def _show_jobs(self, jobs: tuple[JobReport, ...]) -> None:
        self.shown_jobs = jobs
        self.jobs.show(jobs)
        done = next((one for one in jobs if one.job_id == self.simulating and one.ended), None)
        if done is not None:
            self.simulating = ""
            if done.state == "Completed":
                ui.timer(0.01, lambda: self.show_trace(done), once=True)

    async def download(self, job: JobReport) -> None:
        """Give a run's commanded and measured path as a CSV file."""
        if (trace := await self._trace(job.job_id)) is not None:
            with self.frame.client:  # the table may have been drawn anew meanwhile
                ui.download.content(trace_csv(trace), f"{job.job_id}.csv")

    async def _trace(self, job_id: str) -> JobTrace | None:
        traces: list[JobTrace] = []

        async def read() -> None:
            traces.append(await self.session.client.workstation(self.station).trace(job_id))

        return traces[0] if await self.frame.asked(self.words("Read the trace"), read) else None

    async def show_trace(self, job: JobReport) -> None:
        """Read what a run commanded and measured, and lay it out as a replay; nothing plays by itself."""
        words, found = self.words, list[JointTrace]()

        async def read() -> None:
            found.append(await self.session.client.workstation(self.station).joint_trace(job.job_id))

        trace = await self._trace(job.job_id)
        if trace is None or not await self.frame.asked(words("Read the trace"), read):
            return
        measured = words("measured on the arm") if moves(job) else words("simulated, nothing moved")
        when = moment(job.start_time)
        name = f"{job.skill_name} {job.skill_version} · {job.recipe_id} · {when} · {words(job.state)}"
        self.player.load(job.job_id, trace, found[0], title=f"{name} · {measured}", measured=measured)

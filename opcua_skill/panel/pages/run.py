"""Running: simulate, watch it played, run it on the arm, slow down, pause, go on; jobs and what they measured."""

from collections.abc import Callable
from typing import Any
from urllib.parse import quote

from nicegui import ui

from opcua_skill.client import ClientError, JobReport, JobTrace, JointTrace, Recipe, SkillSummary
from opcua_skill.panel.frame import Frame, choose
from opcua_skill.panel.pages.arm import ArmSheet
from opcua_skill.panel.pages.jobs import JobTable
from opcua_skill.panel.player import Player, in_base, trace_csv
from opcua_skill.panel.shown import percent, state_tag

MODES = ("simulation", "test", "production")
VIEWS = {"paths": "From above and the side", "space": "In space", "time": "Over time"}


async def run_page(frame: Frame, skill: str = "", version: str = "0") -> None:
    """Show the workstation that is looked at; ``skill`` and ``version`` are what somebody wants to try."""
    page = RunPage(frame, int(version) if version.isdigit() else 0)
    await page.open(skill)


class RunPage:
    """The page as one browser sees it."""

    def __init__(self, frame: Frame, version: int) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        self.wanted_version = version
        self.skills: dict[str, SkillSummary] = {}
        self.recipes: dict[str, Recipe] = {}
        self.mine = ""
        self.shown_jobs: tuple[JobReport, ...] | None = None
        self.was_active = False
        self.queued: list[str] = []
        self.shown_override = 0
        self.shown_joints: list[float] = []
        self.station = self.session.station_name

    async def open(self, skill: str) -> None:
        """Build the page."""
        with ui.element("div").classes("columns run-columns"):
            with ui.element("div").classes("stack"):
                with ui.element("div").classes("sheet stack"):
                    self._order()
                with ui.element("div").classes("sheet stack"):
                    self._motion()
                with ui.element("div").classes("sheet stack"):
                    self.arm_sheet = ArmSheet(self.frame)
            with ui.element("div").classes("stack"):
                with ui.element("div").classes("sheet stack"):
                    self._view()
                with ui.element("div").classes("sheet scrolls"):
                    self.jobs = JobTable(self.frame, self.show_trace, self.download)
        await self.read_skills(skill)
        self.frame.on_refresh(self.refresh)

    def _view(self) -> None:
        words = self.words
        with ui.element("div").classes("line"):
            toggle = ui.toggle({key: words(label) for key, label in VIEWS.items()}, value="paths")
            toggle.props("no-caps unelevated toggle-color=primary color=white text-color=dark").classes("framed")
            toggle.props('data-mark="view"').on_value_change(lambda event: self.player.view(event.value))
            legend = "grey dashes: planned · blue: commanded · orange: measured"
            ui.label(words(legend)).classes("small soft")
        self.player = Player(words, "max(300px, calc(100vh - 400px))").classes("w-full").props('data-mark="player"')
        self.player.on("drawn", self.drawn)

    async def drawn(self) -> None:
        """Show the arm and the plan as soon as the browser can draw them."""
        workstation = self.session.client.workstation(self.station)

        async def read() -> None:
            self.player.arm(await workstation.links())

        if await self.frame.asked(self.words("Read the arm's links"), read):
            self.shown_joints = []
        await self.show_plan()

    def _order(self) -> None:
        words = self.words
        ui.label(words("What to run")).classes("sheet-title")
        self.skill = choose({}, None, self.skill_chosen, words("Skill")).classes("w-full").props('data-mark="skill"')
        self.recipe = (
            choose({}, None, self.recipe_chosen, words("Recipe")).classes("w-full").props('data-mark="recipe"')
        )
        self.which = ui.label().classes("small soft").props('data-mark="which"')
        with ui.element("div").classes("line"):
            self.buttons = {
                mode: ui.button(words(label), icon=icon, on_click=self._starter(mode))
                .props(look)
                .props(f'data-mark="run-{mode}"')
                for mode, label, icon, look in (
                    ("simulation", "Simulate", "visibility", "no-caps outline dense"),
                    ("test", "Test, slow", "directions_walk", "no-caps outline dense"),
                    ("production", "Run", "play_arrow", "no-caps unelevated dense"),
                )
            }
        ui.label(words("Simulate moves nothing. Test runs at 25 % of full speed at most.")).classes("small soft")
        self.refusal = ui.label().classes("check-bad small").props('data-mark="refusal"')

    def _starter(self, mode: Any) -> Callable[[], Any]:
        return lambda: self.start(mode)

    def _motion(self) -> None:
        words = self.words
        ui.label(words("Motion")).classes("sheet-title")
        self.job = ui.html("", sanitize=False).props('data-mark="job"')
        self.job_told = ui.label().classes("small")
        self.progress = ui.linear_progress(0.0, show_value=False, size="10px").props("instant-feedback")
        with ui.element("div").classes("line"):
            self.pause = ui.button(words("Pause"), icon="pause", on_click=lambda: self.steer("pause"))
            self.pause.props("no-caps outline dense").props('data-mark="pause"')
            self.resume = ui.button(words("Go on"), icon="play_arrow", on_click=lambda: self.steer("resume"))
            self.resume.props("no-caps outline dense").props('data-mark="resume"')
            self.abort = ui.button(words("Abort"), icon="stop", on_click=lambda: self.steer("abort"))
            self.abort.props("no-caps outline dense color=negative").props('data-mark="abort"')
            self.home = ui.button(words("Go to the start"), icon="home", on_click=self.go_home)
            self.home.props('no-caps outline dense data-mark="home"').tooltip(
                words("Slowly, to where every run begins")
            )
        self.queue = ui.element("div").classes("stack").props('data-mark="queue"')
        self.override_told = ui.label().classes("small").props('data-mark="override-told"')
        self.override = ui.slider(min=5, max=100, step=5, value=100).props(
            f'label snap aria-label="{words("Speed override")}"'
        )
        self.override.on("change", self.set_override).props('data-mark="override"')

    async def read_skills(self, wanted: str) -> None:
        """Offer the skills deployed here first, then the others, which can be simulated."""

        async def read() -> None:
            client = self.session.client
            found = await client.find_skills(limit=500)
            for one in await client.find_skills(workstation=self.station, limit=500):
                found = [one, *(other for other in found if other.name != one.name)]
            self.skills = {one.name: one for one in found}

        if not await self.frame.asked(self.words("Read the skills"), read):
            return
        labels = {
            name: f"{name} ({self.words('deployed')})" if self.station in one.workstations else name
            for name, one in self.skills.items()
        }
        self.skill.set_options(labels, value=wanted if wanted in labels else next(iter(labels), None))

    async def skill_chosen(self) -> None:
        """Offer the skill's recipes."""
        name = self.skill.value
        if not name:
            return

        async def read() -> None:
            self.recipes = {one.recipe_id: one for one in await self.session.client.recipes(name)}

        if await self.frame.asked(self.words("Read the recipes"), read):
            fitting = [one.recipe_id for one in self.recipes.values() if one.skill_version == self.wanted_version]
            first = next(iter(fitting or self.recipes), None)
            before = self.recipe.value
            self.recipe.set_options(list(self.recipes), value=first)
            if before == first:
                await self.recipe_chosen()

    async def recipe_chosen(self) -> None:
        """Say which version runs, and show where it would go."""
        await self.say_which()
        await self.show_plan()

    async def say_which(self) -> None:
        """Say which version this recipe would run, and whether it is the one somebody wanted to try."""
        skill, recipe = self.skills.get(self.skill.value or ""), self.recipes.get(self.recipe.value or "")
        if skill is None or recipe is None:
            self.which.text = ""
            return
        words = self.words
        deployed = self.station in skill.workstations
        number = recipe.skill_version or skill.version
        why = words("by recipe") if recipe.skill_version else words("deployed") if deployed else words("newest")
        self.which.text = (
            f"{words('Version')} {number} ({why}) · {words(recipe.timing)} · "
            f"{words.figures(f'{1000 * recipe.time_step:g} ms')}"
        )
        if self.wanted_version and self.wanted_version != number:
            self.which.text += f" · ⚠ {words('not version')} {self.wanted_version}: {words('make a recipe for it')}"

    async def show_plan(self) -> None:
        """Show where the nozzle would go with the chosen recipe."""
        recipe, skill = self.recipes.get(self.recipe.value or ""), self.skills.get(self.skill.value or "")
        if recipe is None or skill is None:
            return
        try:
            path = await self.session.client.path(skill.name, recipe.skill_version or skill.version)
        except ClientError as error:
            self.refusal.text = f"✕ {self.words.said(error)}"
            return
        self.player.plan(in_base(path, recipe))

    async def start(self, mode: Any) -> None:
        """Have a run checked and queued. Where the server says no, its sentence stays on the page."""
        self.refusal.text = ""
        name, recipe = self.skill.value, self.recipe.value
        try:
            workstation = self.session.client.workstation(self.session.station_name)
            started = await workstation.execute(name or "", recipe_id=recipe or "", mode=mode)
        except ClientError as error:
            self.refusal.text = f"✕ {self.words.said(error)}"
            return
        self.mine = started.job_id
        self.player.begin()
        self.session.look_again()

    async def steer(self, what: str) -> None:
        """Pause, resume or abort what runs here."""
        job = self.active()
        if job is None:
            return
        workstation = self.session.client.workstation(self.session.station_name)
        ask = {"pause": workstation.pause, "resume": workstation.resume, "abort": workstation.abort}[what]
        await self.frame.asked(self.words(what.capitalize()), lambda: ask(job.job_id))
        self.session.look_again()

    async def go_home(self) -> None:
        """Have the arm go to where every run starts: needed after a stop on the path."""
        workstation = self.session.client.workstation(self.session.station_name)
        comment = f"{self.session.user} at the panel"
        if await self.frame.asked(self.words("Go to the start"), lambda: workstation.go_home(comment)):
            self.refusal.text = ""
            self.session.look_again()

    async def set_override(self) -> None:
        """Ask for another speed."""
        fraction = float(self.override.value or 100.0) / 100.0
        workstation = self.session.client.workstation(self.session.station_name)
        await self.frame.asked(self.words("Speed override"), lambda: workstation.set_speed_override(fraction))

    def active(self) -> JobReport | None:
        """The job that runs, or the one that waits longest."""
        jobs = self.session.station.active
        running = [one for one in jobs if one.state != "Queued"]
        return next(iter(running or jobs[-1:]), None)

    def refresh(self) -> None:
        """Show what the session knows of job, arm and jobs."""
        session, words = self.session, self.words
        if session.station_name != self.station:
            self.station, self.shown_jobs = session.station_name, None
            ui.navigate.to(f"/run?skill={quote(self.skill.value or '')}")
            return
        job, arm = self.active(), session.station.arm
        for mode, button in self.buttons.items():
            button.set_enabled(session.connected and session.may("run") and bool(self.skill.value) and mode in MODES)
        waiting = len([one for one in session.station.active if one.state == "Queued"])
        if job is None:
            self.job.content = words("Nothing runs here.")
            self.job_told.text, self.progress.value = "", 0.0
        else:
            self.job.content = state_tag(words, job.state)
            rest = f" · {waiting} {words('waiting')}" if waiting else ""
            told = f"{job.skill_name} {words('version')} {job.skill_version} · {words(job.mode)} · {job.recipe_id}"
            self.job_told.text = f"{told} · {percent(job.progress)}{rest}"
            self.progress.value = job.progress
        self.arm_sheet.refresh()
        self.home.set_enabled(session.may("run") and job is None and arm is not None and arm.mode == "idle")
        self.pause.set_enabled(job is not None and job.state == "Running")
        self.resume.set_enabled(job is not None and job.state == "Paused")
        self.abort.set_enabled(job is not None and job.state != "Stopping")
        if arm is not None:
            self.override_told.text = f"{words('Speed override')}: {percent(arm.speed_override)}"
            if (told := round(100.0 * arm.speed_override)) != self.shown_override:
                self.shown_override = told  # somebody set it, here or elsewhere: the slider never says something else
                self.override.value = told
            joints = arm.position.round(4).tolist()
            if joints != self.shown_joints:
                self.shown_joints = joints
                self.player.pose(arm.position)
            if not self.was_active and job is not None:
                self.player.begin()
            if job is not None and job.mode != "simulation" and job.state in ("Running", "Paused", "Stopping"):
                self.player.live(arm.tool_pose[:3])
        self.was_active = job is not None
        if session.station.jobs != self.shown_jobs:
            self._show_jobs(session.station.jobs)

    def _show_jobs(self, jobs: tuple[JobReport, ...]) -> None:
        before = {one.job_id: one for one in self.shown_jobs or ()}
        self.shown_jobs = jobs
        self.jobs.show(jobs)
        self._show_queue([one for one in reversed(jobs) if one.state == "Queued"])
        for one in jobs:
            was = before.get(one.job_id)
            ended_now = one.ended and (one.job_id == self.mine or (was is not None and not was.ended))
            if ended_now and one.state == "Completed":
                self.mine = ""
                ui.timer(0.01, lambda it=one: self.show_trace(it.job_id, True), once=True)
                break

    def _show_queue(self, waiting: list[JobReport]) -> None:
        """List what waits, the next one first; each can be taken out."""
        words, ids = self.words, [one.job_id for one in waiting]
        if ids == self.queued:
            return
        self.queued = ids
        self.queue.clear()
        with self.queue:
            if waiting:
                ui.label(f"{words('Queue')}: {len(waiting)} {words('waiting')}").classes("small soft")
            for place, one in enumerate(waiting, start=1):
                with ui.element("div").classes("line queued"):
                    ui.label(f"{place}. {one.skill_name} {one.skill_version} · {words(one.mode)}").classes("small")
                    ui.space()
                    ui.button(icon="close", on_click=lambda _, it=one: self.take_out(it)).props("flat round").props[
                        "aria-label"
                    ] = f"{words('Take out of the queue')} {place}"

    async def take_out(self, job: JobReport) -> None:
        """Abort a job that waits."""
        workstation = self.session.client.workstation(self.session.station_name)
        await self.frame.asked(self.words("Abort"), lambda: workstation.abort(job.job_id))
        self.session.look_again()

    async def download(self, job_id: str) -> None:
        """Give a run's commanded and measured path as a CSV file."""
        if (trace := await self._trace(job_id)) is not None:
            with self.frame.client:  # the table may have been drawn anew meanwhile
                ui.download.content(trace_csv(trace), f"{job_id}.csv")

    async def _trace(self, job_id: str) -> JobTrace | None:
        traces: list[JobTrace] = []

        async def read() -> None:
            traces.append(await self.session.client.workstation(self.station).trace(job_id))

        return traces[0] if await self.frame.asked(self.words("Read the trace"), read) else None

    async def show_trace(self, job_id: str, play: bool) -> None:
        """Read what a run commanded and measured, and play it."""
        found: list[JointTrace] = []

        async def read() -> None:
            found.append(await self.session.client.workstation(self.station).joint_trace(job_id))

        trace = await self._trace(job_id)
        if trace is not None and await self.frame.asked(self.words("Read the trace"), read):
            self.player.load(job_id, trace, found[0], play=play)

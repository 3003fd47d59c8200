"""What to run: skill, recipe and mode chosen, the server's own check of it, and one run for one press."""

import json
from collections.abc import Awaitable, Callable
from urllib.parse import urlencode

from nicegui import ui

from opcua_skill.client import ClientError, JobReport, Mode, Recipe, SkillSummary
from opcua_skill.panel.card import cannot_run
from opcua_skill.panel.layout import Frame, choose, stopped, title
from opcua_skill.panel.modes import LOOKS, mode_tag, moves
from opcua_skill.panel.pages.card import CardSheet

MOVING: tuple[Mode, ...] = ("test", "production")
WANTED_KINDS = frozenset({"SkillVersionStateEventType", "DeploymentEventType"})


class OrderSheet:
    """The sheet on the run page. ``card`` shows what was chosen, ``started`` is told of a job that was made."""

    def __init__(
        self, frame: Frame, station: str, card: CardSheet, chosen: Callable[[], Awaitable[None]],
        started: Callable[[str, Mode], None],
    ) -> None:  # fmt: skip
        self.frame, self.words, self.session = frame, frame.words, frame.session
        self.station, self.card, self.chosen, self.started = station, card, chosen, started
        self.skills: dict[str, SkillSummary] = {}
        self.recipes: dict[str, Recipe] = {}
        self.wanted_version = 0
        self.asking = False
        self.pending = ""
        self.shown_skill: str | None = None
        self.shown_recipe: str | None = None
        self.seen = self.session.happenings[0].number if self.session.happenings else 0
        words = self.words
        title(words("What to run"))
        self.skill = choose({}, None, self.skill_chosen, words("Skill")).classes("w-full").props('data-mark="skill"')
        self.recipe = (
            choose({}, None, self.recipe_chosen, words("Recipe")).classes("w-full").props('data-mark="recipe"')
        )
        self.which = ui.label().classes("small soft").props('data-mark="which"')
        self.buttons: dict[Mode, ui.button] = {}
        self.reasons: dict[Mode, ui.label] = {}
        for mode in LOOKS:
            self._mode(mode)
        self.queue_button = ui.button(words("Queue another …"), icon="playlist_add", on_click=self._ask)
        self.queue_button.props('no-caps outline data-mark="queue-another"')
        self.another = ui.element("div").classes("asked stack").props('data-mark="asked-another" role=group')
        self.another.set_visibility(False)
        self.refusal = ui.label().classes("check-bad small").props('data-mark="refusal" role=alert')

    def _mode(self, mode: Mode) -> None:
        words, look = self.words, LOOKS[mode]
        with ui.element("div").classes(f"mode-line mode-line-{mode}"):
            button = ui.button(words(look.button), icon=look.icon, color=None, on_click=lambda: self.start(mode))
            button.props(f'no-caps unelevated data-mark="run-{mode}"').classes(f"mode-button mode-{mode}")
            with ui.element("div").classes("mode-words"):
                ui.html(mode_tag(words, mode), sanitize=False)
                ui.label(words(look.moves)).classes("small")
            reason = ui.label().classes("small mode-reason").props(f'data-mark="why-{mode}"')
        self.buttons[mode], self.reasons[mode] = button, reason

    async def read(self, skill: str, recipe: str, version: int) -> None:
        """Offer the skills deployed here first; chosen is what somebody asked for, else what ran here last."""
        self.wanted_version = version

        async def ask() -> None:
            client = self.session.client
            found = await client.find_skills(limit=500)
            for one in await client.find_skills(workstation=self.station, limit=500):
                found = [one, *(other for other in found if other.name != one.name)]
            self.skills = {one.name: one for one in found}

        if not await self.frame.asked(self.words("Read the skills"), ask):
            return
        ran = (one for one in self.session.station.jobs if moves(one))
        last = next((one for one in ran if one.skill_name in self.skills), None)
        labels = {
            name: f"{name} ({self.words('deployed')})" if self.station in one.workstations else name
            for name, one in self.skills.items()
        }
        wanted = skill if skill in labels else last.skill_name if last is not None and not skill else None
        self.shown_skill = wanted
        self.skill.set_options(labels, value=wanted)
        await self._offer_recipes(recipe)

    async def skill_chosen(self) -> None:
        """Somebody chose another skill."""
        if self.skill.value != self.shown_skill:
            self.shown_skill = self.skill.value
            await self._offer_recipes()

    async def _offer_recipes(self, recipe: str = "") -> None:
        """Offer the skill's recipes; chosen is the one asked for, or the one that ran here last with it, or none."""
        name = self.skill.value
        self.recipes = {}
        if name:

            async def ask() -> None:
                self.recipes = {one.recipe_id: one for one in await self.session.client.recipes(name)}

            await self.frame.asked(self.words("Read the recipes"), ask)
        wanted = recipe if recipe in self.recipes else self._last_recipe(name or "")
        self.shown_recipe = wanted
        self.recipe.set_options(list(self.recipes), value=wanted)
        await self._show()

    def _last_recipe(self, skill: str) -> str | None:
        ran = (one.recipe_id for one in self.session.station.jobs if one.skill_name == skill and moves(one))
        return next((one for one in ran if one in self.recipes), None)

    async def recipe_chosen(self) -> None:
        """Somebody chose another recipe."""
        if self.recipe.value != self.shown_recipe:
            self.shown_recipe = self.recipe.value
            await self._show()

    async def _show(self) -> None:
        """Say which version runs, have the run checked, and show where it would go."""
        self.another.set_visibility(False)
        self.refusal.text = ""
        self._tell_address()
        recipe = self.chosen_recipe
        if recipe is None:
            missing = "Choose a recipe: how the skill is to be run." if self.skill.value else "Choose a skill to run."
            self.card.clear(self.words(missing))
            self.which.text = ""
        else:
            self._say_which(recipe)
            await self.card.show(recipe)
            self._say_which(recipe)
        self.refresh()
        await self.chosen()

    @property
    def chosen_recipe(self) -> Recipe | None:
        """The recipe that is chosen, None while none is."""
        return self.recipes.get(self.recipe.value or "")

    def _tell_address(self) -> None:
        """Let the address say what the page shows, so that a reload or a link shows the same."""
        said = {"skill": self.skill.value or "", "recipe": self.recipe.value or "", "version": self.wanted_version}
        address = f"/run?{urlencode({key: value for key, value in said.items() if value})}"
        with self.frame.client:
            ui.run_javascript(f"history.replaceState(history.state, '', {json.dumps(address)})")

    def _say_which(self, recipe: Recipe) -> None:
        words, check, skill = self.words, self.card.check, self.skills.get(self.skill.value or "")
        if skill is None:
            self.which.text = ""
            return
        number = check.version if check is not None else recipe.skill_version or skill.version
        deployed = self.station in skill.workstations
        why = words("by recipe") if recipe.skill_version else words("deployed") if deployed else words("newest")
        self.which.text = (
            f"{words('Version')} {number} ({why}) · {words(recipe.timing)} · "
            f"{words.figures(f'{1000 * recipe.time_step:g} ms')}"
        )
        if self.wanted_version and self.wanted_version != number:
            self.which.text += f" · ⚠ {words('not version')} {self.wanted_version}: {words('make a recipe for it')}"

    def why_not(self, mode: Mode, *, behind: bool = False) -> str:
        """Return why a run in this mode would be refused, or is not offered; ``behind``: asked to wait for others."""
        words, session, station, look = self.words, self.session, self.session.station, LOOKS[mode]
        if not session.live:
            return words("no connection, or the server does not answer")
        if not session.may(look.right):
            return words(f"needs the role {look.role}")
        if self.chosen_recipe is None:
            return words("choose skill and recipe first")
        if self.asking or self.pending:
            return words("asked for already")
        check = self.card.check
        if check is None:
            return words("not checked by the server yet")
        if not check.can_run:
            return cannot_run(words, check)
        if check.refused.get(mode):
            return words.said(check.refused[mode])
        if mode == "simulation":
            simulating = any(not moves(one) for one in station.active)
            return words("a simulation is under way") if simulating else ""
        if stopped(station):
            return words("the arm waits for a reset")
        lock = station.lock
        if lock is not None and lock.locked and not session.has_lock(station.name):
            return f"{words('This arm is kept by')} {lock.user}"
        if not behind and (self.ahead or self.held):
            return words("something runs or waits here: see below")
        return ""

    @property
    def ahead(self) -> list[JobReport]:
        """The jobs of the arm that run or wait: whatever is asked for now comes after them."""
        return [one for one in self.session.station.active if moves(one)]

    @property
    def held(self) -> bool:
        """Whether the queue waits for somebody to release it."""
        queue = self.session.station.queue
        return queue is not None and queue.held

    def _ask(self) -> None:
        """Ask before something is queued that would begin by itself, when nobody thinks of it any more."""
        words = self.words
        self.another.clear()
        self.another.set_visibility(True)
        with self.another:
            now = "; ".join(f"{one.skill_name} {words(one.state)}" for one in self.ahead)
            told = words("Queue another run? It begins by itself when its turn comes.")
            if self.held:
                told = words("The queue is held: a run waits there until somebody releases it.")
            ui.label(f"{self.station}: {now or words('nothing runs')}. {told}")
            ui.label(f"{self.skill.value} · {self.recipe.value}").classes("sheet-title")
            with ui.element("div").classes("line"):
                for mode in MOVING:
                    if not self.why_not(mode, behind=True):
                        yes = ui.button(f"{words('Yes, queue')}: {words(LOOKS[mode].name)}", color=None)
                        yes.on_click(lambda _, it=mode: self.start(it, behind=True))
                        yes.props(f'no-caps unelevated data-mark="queue-{mode}"').classes(f"mode-{mode}")
                ui.button(words("No"), on_click=lambda: self.another.set_visibility(False)).props("no-caps outline")

    async def start(self, mode: Mode, *, behind: bool = False) -> None:
        """Have a run checked and queued. Where the server says no, its sentence stays on the page."""
        if self.why_not(mode, behind=behind):
            return  # the second press of a double one
        self.asking = True
        self.another.set_visibility(False)
        self.refusal.text = ""
        self.refresh()
        try:
            workstation = self.session.client.workstation(self.station)
            begun = await workstation.execute(self.skill.value or "", recipe_id=self.recipe.value or "", mode=mode)
        except ClientError as error:
            self.refusal.text = f"✕ {self.words.said(error)}"
            return
        finally:
            self.asking = False
        self.pending = begun.job_id
        self.started(begun.job_id, mode)
        self.session.look_again()

    def refresh(self) -> None:
        """Offer what can be had now; say of the rest why not."""
        if self.pending and any(one.job_id == self.pending for one in self.session.station.jobs):
            self.pending = ""
        for mode, button in self.buttons.items():
            reason = self.why_not(mode)
            if button.enabled == bool(reason):
                button.set_enabled(not reason)
            if self.reasons[mode].text != reason:
                self.reasons[mode].text = reason
        waits = bool(self.ahead) or self.held
        self.queue_button.set_visibility(waits)
        self.queue_button.set_enabled(waits and any(not self.why_not(one, behind=True) for one in MOVING))
        if self.another.visible and not self.ahead and not self.held:
            self.another.set_visibility(False)

    async def look(self) -> None:
        """Have the choice checked again when a version or a deployment has changed, here or elsewhere."""
        fresh = [one.event for one in self.session.happenings if one.number > self.seen]
        if fresh:
            self.seen = self.session.happenings[0].number
        mine = [one for one in fresh if one.skill_name == self.skill.value]
        if any(one.kind.Identifier in WANTED_KINDS for one in mine) and self.session.live:
            await self.read(self.skill.value or "", self.recipe.value or "", self.wanted_version)

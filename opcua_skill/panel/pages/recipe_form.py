"""One recipe in a form: every value with its unit, range and default; what the server refuses is told at its field."""

from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from nicegui import ui

from opcua_skill.client import ClientError, Recipe, Refused
from opcua_skill.panel.card import cannot_run, in_short
from opcua_skill.panel.formatting import seconds
from opcua_skill.panel.layout import Frame, choose
from opcua_skill.panel.recipe_fields import (
    FIELDS,
    NOZZLE_FIELDS,
    PLACE_FIELDS,
    TIMING_FIELDS,
    TURN_FIELDS,
    Field,
    choice_fields,
    field_at_fault,
    parameter_fields,
    quaternion,
    turned,
)

TIMINGS = {"demonstrated": "as demonstrated", "constant_speed": "constant speed", "time_optimal": "as fast as allowed"}
CHOICE_WORDS = {
    "slow": "slow down",
    "refuse": "refuse the run",
    "flag": "tell it",
    "stop": "stop",
    "shown": "as shown",
    "free": "free",
}
Read = Callable[[str], Awaitable[None]]


class RecipeForm:
    """The form. ``parameters`` are what the skill declares; ``newest`` is its newest version."""

    def __init__(
        self, frame: Frame, one: Recipe, newest: int, parameters: Sequence[Mapping[str, Any]], may: bool, read: Read
    ) -> None:
        self.frame, self.words, self.session = frame, frame.words, frame.session
        self.one, self.read = one, read
        self.numbers: dict[str, tuple[Field, ui.number]] = {}
        self.extra = parameter_fields(parameters)
        self.choices: dict[str, ui.select] = {}
        self.defaults = {name: default for name, _, default, _ in choice_fields(parameters)}
        words = self.words
        with ui.element("div").classes("form-part"):
            self.name = ui.input(words("Name of the recipe"), value=one.recipe_id).props("dense outlined")
            self.name.props('data-mark="recipe-id"')
            self.product = ui.input(words("Product"), value=one.product).props("dense outlined")
            versions = {str(n): f"{words('version')} {n}" for n in range(newest, 0, -1)}
            if one.skill_version > newest:
                versions[str(one.skill_version)] = f"{words('version')} {one.skill_version}"
            self.version = choose(
                {"0": words("the deployed one"), **versions},
                str(one.skill_version),
                label=words("Version of the skill"),
            )
        self._part("Motion in time")
        with ui.element("div").classes("form-part"):
            self.timing = choose(
                {key: words(label) for key, label in TIMINGS.items()}, one.timing, label=words("Timing")
            )
            for field in TIMING_FIELDS:
                self._number(field, getattr(one, field.name))
        self._part("Nozzle")
        with ui.element("div").classes("form-part"):
            for field in NOZZLE_FIELDS:
                self._number(field, getattr(one, field.name))
        self._part("Where the part is, in the arm's base; turned about x first, then y, then z")
        with ui.element("div").classes("form-part form-part-6"):
            for place, field in enumerate(PLACE_FIELDS):
                self._number(field, one.frame[place], label=field.name)
            for degrees, field in zip(turned(one.frame), TURN_FIELDS, strict=True):
                self._number(field, degrees, label=f"{words(field.label)} {field.name[-1]}")
        if parameters:
            self._part("Parameters of motion and process")
            with ui.element("div").classes("form-part"):
                for field in self.extra:
                    self._number(field, float(one.parameters.get(field.name, field.default)))
                for name, label, default, options in choice_fields(parameters):
                    self.choices[name] = choose(
                        {option: words(CHOICE_WORDS[option]) for option in options},
                        str(one.parameters.get(name, default)),
                        label=words(label),
                    )
        saved = ui.label().classes("lines").props('data-mark="recipe-checked" role=status')
        name, (good, told) = self.session.kept.get("checked recipe", ("", (True, "")))  # type: ignore[misc]
        if name == one.recipe_id:
            saved.text = told
            saved.classes("check-good" if good else "check-bad")
        self.wrong = ui.label().classes("check-bad").props('data-mark="recipe-refusal"')
        with ui.element("div").classes("line"):
            keep = ui.button(words("Save and check"), on_click=self.save).props(
                'no-caps unelevated data-mark="save-recipe"'
            )
            back = ui.button(words("Default values"), on_click=self.default).props(
                'no-caps outline data-mark="defaults"'
            )
            delete = ui.button(words("Delete …"), on_click=lambda: sure.set_visibility(True))
            delete.props("no-caps flat color=negative")
            for button in (keep, back, delete):
                frame.gate(button, lambda: "" if may else words("Changing recipes needs the role engineer."))
            note = "Another name makes a new recipe." if may else "Changing recipes needs the role engineer."
            ui.label(words(note)).classes("small soft")
        with ui.element("div").classes("asked line").props('data-mark="sure-delete"') as sure:
            ui.label(f"{words('Delete this recipe for good?')} {one.recipe_id}")
            ui.button(words("Yes, delete"), on_click=self.delete).props("no-caps outline color=negative")
            ui.button(words("No"), on_click=lambda: sure.set_visibility(False)).props("no-caps flat")
        sure.set_visibility(False)

    def _part(self, title: str) -> None:
        ui.label(self.words(title)).classes("form-title").props("role=heading aria-level=3")

    def _number(self, field: Field, stored: float, label: str = "") -> None:
        words = self.words
        name = label or words(field.label)
        shown = f"{name} ({field.unit})" if field.unit else name
        made = ui.number(shown, value=field.shown(stored), step=field.step, validation=self._range(field))
        made.props("dense outlined").props(f'data-mark="field-{field.name}"')
        told = " · ".join(
            part for part in (words.figures(field.range), words(field.hint) if field.hint else "") if part
        )
        made.props["hint"] = told
        self.numbers[field.name] = (field, made)

    def _range(self, field: Field) -> Callable[[Any], str | None]:
        def check(value: Any) -> str | None:
            fault = field.fault(value)
            return f"{self.words('allowed')}: {self.words.figures(fault)}" if fault else None

        return check

    def _stored(self, field: Field) -> float:
        return float(self.numbers[field.name][1].value or 0.0) / field.scale

    def edited(self) -> Recipe:
        """Return the recipe as the form shows it."""
        one = self.one
        degrees = tuple(self._stored(field) for field in TURN_FIELDS)
        turn = one.frame[3:7] if degrees == turned(one.frame) else quaternion(degrees)
        # what stands at its default and was not in the recipe stays out of it
        parameters = dict(one.parameters)
        values: Iterable[tuple[str, float | str, float | str]] = (
            *((field.name, self._stored(field), field.default) for field in self.extra),
            *((name, str(made.value), self.defaults[name]) for name, made in self.choices.items()),
        )
        for name, value, default in values:
            same = value == default or (
                isinstance(value, float) and isinstance(default, float) and abs(value - default) < 1e-12
            )
            if name in parameters or not same:
                parameters[name] = value
        return replace(
            one,
            recipe_id=(self.name.value or "").strip(),
            product=self.product.value or "",
            skill_version=int(self.version.value or 0),
            timing=self.timing.value,  # type: ignore[arg-type]
            frame=(*(self._stored(field) for field in PLACE_FIELDS), *turn),
            parameters=parameters,
            **{field.name: self._stored(field) for field in FIELDS},
        )

    def default(self) -> None:
        """Put every value back to what a new recipe has; name, product, version and the part's place stay."""
        for field, made in self.numbers.values():
            if field not in PLACE_FIELDS and field not in TURN_FIELDS:
                made.value = field.shown(field.default)
        self.timing.value = Recipe("", "").timing
        for name, made in self.choices.items():
            made.value = self.defaults[name]

    async def save(self) -> None:
        """Have the recipe stored; whatever is wrong with it is told at its field, or below the form."""
        words = self.words
        self.wrong.text = ""
        faults = [field for field, made in self.numbers.values() if field.fault(made.value)]
        if faults:
            told = (f"{words(field.label)}: {words('allowed')} {words.figures(field.range)}" for field in faults)
            self.wrong.text = f"✕ {'; '.join(told)}"
            return
        try:
            await self.session.client.put_recipe(self.edited())
        except ClientError as error:
            self._refused(error)
            return
        name = (self.name.value or "").strip()
        self.session.kept["checked recipe"] = (name, await self._checked())
        await self.read(name)

    async def _checked(self) -> tuple[bool, str]:
        """Have the recipe that was saved checked by the server, and say in a line whether it can run."""
        words, station = self.words, self.session.station_name
        try:
            check = await self.session.client.workstation(station).check(self.edited())
        except ClientError as error:
            return False, f"⚠ {words('Saved, but it could not be checked')}: {words.said(error)}"
        if not check.can_run:
            why = "; ".join(words.said(one.text) for one in check.findings)
            return False, f"⚠ {words('Saved, but on')} {station}: {cannot_run(words, check)}. {why}"
        told = f"✓ {words('Saved. It can run on')} {station}: {seconds(check.facts['pathDuration'])}"
        slow = "; ".join(in_short(words, one) for one in check.findings)
        return True, words.figures(f"{told}{' · ' + slow if slow else ''}")

    def _refused(self, error: ClientError) -> None:
        name = field_at_fault(error)
        at = {"recipe_id": self.name, "product": self.product, "frame": self.numbers["x"][1]}
        at |= {key: made for key, (_, made) in self.numbers.items()}
        if name in at and isinstance(error, Refused):
            at[name].error = self.words.said(error.reason)
        self.wrong.text = f"✕ {self.words.said(error)}"

    async def delete(self) -> None:
        """Have the recipe deleted."""
        try:
            await self.session.client.delete_recipe(self.one.recipe_id)
        except ClientError as error:
            self.wrong.text = f"✕ {self.words.said(error)}"
            return
        await self.read("")

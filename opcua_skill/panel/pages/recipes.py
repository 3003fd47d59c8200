"""Recipes: how one skill is run for one product, in a form with units and ranges. People see millimetres."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import quote

from nicegui import ui

from opcua_skill.client import ClientError, Recipe
from opcua_skill.panel.frame import Frame, choose


@dataclass(frozen=True, slots=True)
class Field:
    """A number of a recipe as people see it: ``scale`` turns the stored SI value into the shown one."""

    name: str
    label: str
    unit: str
    low: float
    high: float
    scale: float
    step: float
    hint: str = ""

    def shown(self, recipe: Recipe) -> float:
        """Return the value as shown."""
        return round(getattr(recipe, self.name) * self.scale, 6)

    def fault(self, value: Any) -> str:
        """Return the range if a shown value lies outside it; empty if it is fine. ``{}`` is filled by the page."""
        good = isinstance(value, int | float) and self.low <= value <= self.high
        return "" if good else f"{self.low:g} … {self.high:g} {self.unit}"


FIELDS = (
    Field("time_step", "Time step", "ms", 0.5, 100.0, 1000.0, 1.0),
    Field("duration", "Duration", "s", 0.0, 3600.0, 1.0, 0.5, "0: as taught"),
    Field("speed", "Nozzle speed", "mm/s", 0.0, 5000.0, 1000.0, 5.0, "for constant speed"),
    Field("speed_override", "Speed override", "%", 1.0, 100.0, 100.0, 5.0),
    Field("standoff", "Distance of the nozzle from the part", "mm", 0.0, 500.0, 1000.0, 0.5),
    Field("approach_height", "Approach from above", "mm", 0.0, 1000.0, 1000.0, 5.0),
    Field("retract_height", "Retract upwards", "mm", 0.0, 1000.0, 1000.0, 5.0),
    Field("dispense_lead", "Valve opens earlier by", "ms", -5000.0, 5000.0, 1000.0, 10.0),
    Field("max_deviation", "Largest distance from the path", "mm", 0.0, 1000.0, 1000.0, 0.1, "0: not checked"),
)
PLACE = ("x", "y", "z")
TIMINGS = {"demonstrated": "as demonstrated", "constant_speed": "constant speed", "time_optimal": "as fast as allowed"}


async def recipes_page(frame: Frame, skill: str = "") -> None:
    """Show a skill's recipes, and the chosen one in a form."""
    words, session = frame.words, frame.session
    may = session.may("recipes")
    recipes: dict[str, Recipe] = {}
    known: dict[str, int] = {}

    with ui.element("div").classes("columns").style("grid-template-columns: 300px minmax(0,1fr)"):
        with ui.element("div").classes("sheet stack"):
            ui.label(f"{words('Recipes')} · {skill}").classes("sheet-title")
            listed = ui.element("div").classes("stack").props('data-mark="recipes"')
            ui.link(words("Back to the skill"), f"/skill/{quote(skill, safe='')}").classes("small")
        form = ui.element("div").classes("sheet stack")

    async def read(chosen: str = "") -> None:
        async def ask() -> None:
            found = await session.client.recipes(skill)
            recipes.clear()
            recipes.update({one.recipe_id: one for one in found})
            known["newest"] = (await session.client.skill(skill)).version

        if not await frame.asked(words("Read the recipes"), ask):
            return
        listed.clear()
        with listed:
            for one in recipes.values():
                ui.button(one.recipe_id, on_click=lambda _, it=one: show(it)).props(
                    "no-caps flat dense align=left"
                ).classes("w-full")
        if first := recipes.get(chosen) or next(iter(recipes.values()), None):
            show(first)

    def show(one: Recipe) -> None:
        form.clear()
        with form:
            _form(frame, one, known.get("newest", 1), may, read)

    await read()


def _form(frame: Frame, one: Recipe, newest: int, may: bool, read: Callable[[str], Any]) -> None:
    words, session = frame.words, frame.session
    with ui.element("div").classes("columns").style("grid-template-columns: repeat(3, minmax(0, 1fr)); gap: 14px"):
        name = (
            ui.input(words("Name of the recipe"), value=one.recipe_id)
            .props("dense outlined")
            .props('data-mark="recipe-id"')
        )
        product = ui.input(words("Product"), value=one.product).props("dense outlined")
        versions = {"0": words("the deployed one"), **{str(n): f"{words('version')} {n}" for n in range(newest, 0, -1)}}
        version = choose(versions, str(one.skill_version), label=words("Version of the skill"))
        timing = choose({key: words(label) for key, label in TIMINGS.items()}, one.timing, label=words("Timing"))
        numbers: dict[str, ui.number] = {}
        for field in FIELDS:
            hint = f", {words(field.hint)}" if field.hint else ""
            numbers[field.name] = (
                ui.number(
                    f"{words(field.label)} ({field.unit}{hint})",
                    value=field.shown(one),
                    step=field.step,
                    validation=_range(words("allowed"), field),
                )
                .props("dense outlined")
                .props(f'data-mark="field-{field.name}"')
            )
        for place, axis in enumerate(PLACE):
            numbers[axis] = ui.number(
                f"{words('Part in the arm’s base')}: {axis} (mm)", value=round(1000.0 * one.frame[place], 3), step=1.0
            ).props("dense outlined")
    turn = " ".join(f"{value:g}" for value in one.frame[3:])
    ui.label(f"{words('Rotation of the part')} (qx qy qz qw): {turn}").classes("small soft mono")
    if one.parameters:
        told = " · ".join(f"{key} = {value}" for key, value in one.parameters.items())
        ui.label(f"{words('Parameters of the process')}: {told}").classes("small soft")
    wrong = ui.label().classes("check-bad").props('data-mark="recipe-refusal"')

    def edited() -> Recipe:
        values = {field.name: float(numbers[field.name].value or 0.0) / field.scale for field in FIELDS}
        frame_values = (*(float(numbers[axis].value or 0.0) / 1000.0 for axis in PLACE), *one.frame[3:])
        return replace(
            one,
            recipe_id=(name.value or "").strip(),
            product=product.value or "",
            skill_version=int(version.value or 0),
            timing=timing.value,  # type: ignore[arg-type]
            frame=frame_values,
            **values,
        )

    async def save() -> None:
        faults = [
            f"{words(field.label)}: {fault}" for field in FIELDS if (fault := field.fault(numbers[field.name].value))
        ]
        if faults:
            wrong.text = f"✕ {'; '.join(faults)}"
            return
        try:
            await session.client.put_recipe(edited())
        except ClientError as error:
            wrong.text = f"✕ {error}"
            return
        frame.tell(f"{words('Saved')}: {name.value}")
        await read((name.value or "").strip())

    async def delete() -> None:
        try:
            await session.client.delete_recipe(one.recipe_id)
        except ClientError as error:
            wrong.text = f"✕ {error}"
            return
        await read("")

    with ui.element("div").classes("line"):
        ui.button(words("Save"), on_click=save).props("no-caps unelevated").props(
            'data-mark="save-recipe"'
        ).set_enabled(may)
        ui.button(words("Delete"), on_click=delete).props("no-caps flat color=negative").set_enabled(may)
        note = "Another name makes a new recipe." if may else "Changing recipes needs the role engineer."
        ui.label(words(note)).classes("small soft")


def _range(allowed: str, field: Field) -> Callable[[Any], str | None]:
    def check(value: Any) -> str | None:
        fault = field.fault(value)
        return f"{allowed}: {fault}" if fault else None

    return check

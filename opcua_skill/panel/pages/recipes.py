"""Recipes: how one skill is run for one product. The list of a skill's recipes, and the chosen one in a form."""

from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from nicegui import ui

from opcua_skill.client import Recipe
from opcua_skill.panel.layout import Frame, title
from opcua_skill.panel.pages.recipe_form import RecipeForm


async def recipes_page(frame: Frame, skill: str = "") -> None:
    """Show a skill's recipes, and the chosen one in a form."""
    words, session = frame.words, frame.session
    may = session.may("recipes")
    recipes: dict[str, Recipe] = {}
    newest = 1
    parameters: Sequence[Mapping[str, Any]] = ()

    with ui.element("div").classes("columns recipe-columns"):
        with ui.element("div").classes("sheet stack"):
            title(f"{words('Recipes')} · {skill}")
            listed = ui.element("div").classes("stack").props('data-mark="recipes"')
            ui.link(words("Back to the skill"), f"/skill/{quote(skill, safe='')}").classes("panel-link")
        form = ui.element("div").classes("sheet stack").props('data-mark="recipe-form"')

    async def read(chosen: str = "") -> None:
        async def ask() -> None:
            nonlocal newest, parameters
            found = await session.client.recipes(skill)
            recipes.clear()
            recipes.update({one.recipe_id: one for one in found})
            described = await session.client.skill(skill)
            newest, parameters = described.version, described.document.get("parameters") or ()

        if not await frame.asked(words("Read the recipes"), ask):
            return
        if first := recipes.get(chosen) or next(iter(recipes.values()), None):
            show(first)

    def show(one: Recipe) -> None:
        listed.clear()
        with listed:
            for other in recipes.values():
                here = "▸ " if other.recipe_id == one.recipe_id else ""
                ui.button(f"{here}{other.recipe_id}", on_click=lambda _, it=other: show(it)).props(
                    "no-caps flat align=left"
                ).classes("w-full")
        form.clear()
        with form:
            RecipeForm(frame, one, newest, parameters, may, read)

    await read()

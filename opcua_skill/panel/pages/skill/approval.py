"""What an approval is about: the run as it would be with a recipe, and what changed since the version approved last."""

from collections.abc import Sequence
from dataclasses import replace
from urllib.parse import quote

from nicegui import ui

from opcua_skill.client import ClientError, Path, Recipe, Skill
from opcua_skill.panel.comparing import changes, told_distance
from opcua_skill.panel.formatting import mm, moment_of, percent
from opcua_skill.panel.layout import choose, title
from opcua_skill.panel.pages.card import CardSheet
from opcua_skill.panel.pages.skill.reviewed import ReviewPage
from opcua_skill.panel.review import largest_change


def approved_before(found: Sequence[Skill], version: int) -> Skill | None:
    """Return the newest version below this one that was approved, whatever became of it; None: there is none."""
    approved = [
        one
        for one in found
        if one.version < version and any(made["state"] == "Approved" for made in one.document.get("decisions") or ())
    ]
    return max(approved, key=lambda one: one.version, default=None)


class RunToApprove:
    """The sheet above the decision."""

    def __init__(self, page: ReviewPage, skill: Skill) -> None:
        self.page, self.words, self.session = page, page.words, page.session
        self.skill = skill
        self.recipes: dict[str, Recipe] = {}
        self.last: tuple[int, Path] | None = None
        self.compared = False
        self.card = CardSheet(page.frame, self.words("What would run"))
        self.recipe = choose({}, None, self._chosen, self.words("Recipe")).classes("w-full")
        self.recipe.props('data-mark="card-recipe"')
        self.recipe.set_visibility(False)
        title(self.words("Since the version approved last"), 3).classes("small-title")
        self.since = ui.label().classes("small lines").props('data-mark="since-approved"')
        ui.timer(0.02, self._read, once=True)

    @property
    def in_address(self) -> str:
        """What to add to the address of the run page, so that it shows the same recipe."""
        return f"&recipe={quote(self.recipe.value, safe='')}" if self.recipe.value else ""

    async def _read(self) -> None:
        try:
            found = await self.session.client.recipes(self.skill.name) if self.session.may("read recipes") else []
        except ClientError as error:
            self.card.clear(f"✕ {self.words.said(error)}")
            return
        self.recipes = {one.recipe_id: one for one in found}
        fitting = [one.recipe_id for one in found if one.skill_version in (0, self.skill.version)]
        self.recipe.set_visibility(len(self.recipes) > 1)
        self.recipe.set_options(list(self.recipes), value=next(iter(fitting or self.recipes), None))
        if not self.recipes:
            self.card.clear(self.words("The card of a run needs the role operator."))

    async def _chosen(self) -> None:
        recipe = self.recipes.get(self.recipe.value or "")
        if recipe is not None and self.compared:  # else the server would check the same twice
            before = self.last[1] if self.last else None
            await self.card.show(replace(recipe, skill_version=self.skill.version), self.skill.version, before)

    async def compare(self, found: Sequence[Skill]) -> None:
        """Say what is different since the version approved last, and lay its path under the card."""
        words, last = self.words, approved_before(found, self.skill.version)
        first, self.compared = not self.compared, True
        if last is None:
            self.since.text = words("No version of this skill was approved before.")
            if first:
                await self._chosen()
            return
        if self.last is None or self.last[0] != last.version:
            try:
                path = await self.session.client.path(last.name, last.version)
            except ClientError as error:
                self.since.text = f"✕ {words.said(error)}"
                return
            self.last, first = (last.version, path), True
        path = self.last[1]
        made = next(one for one in last.document["decisions"] if one["state"] == "Approved")
        away, where = told_distance(self.skill, last) or largest_change(path, self.page.version.material.path)
        moved = f"{words('path moved by at most')} {words.figures(mm(away))}, {words('at')} {percent(where)}"
        who = f"{words('version')} {last.version}, {made['actor']}, {moment_of(made.get('at'))}"
        self.since.text = "\n".join([f"{who}:", moved, *changes(words, last, self.skill)])
        if first:
            await self._chosen()

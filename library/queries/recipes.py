"""Recipes: put, read, listed and deleted; a skill's default recipe stays."""

from collections.abc import Iterable

import sqlalchemy as sql

from library.description import SkillDescription
from library.errors import AlreadyExists, InUse, InvalidValue, NotFound
from library.lifecycle import FINAL_JOB_STATES
from library.queries import versions
from library.queries.encoding import stored
from library.recipe import Recipe
from library.tables import jobs, recipes, skills
from library.values import MAX_RECIPE_ID, now


def put(connection: sql.Connection, recipe: Recipe, actor: str) -> None:
    """Store a recipe, or change the one with that id; its process parameters have to be ones the skill has."""
    check_parameters(recipe, versions.read(connection, recipe.skill_name, recipe.skill_version))
    owner = _skill_of(connection, recipe.recipe_id)
    if owner not in {None, recipe.skill_name}:
        raise AlreadyExists("recipe", recipe.recipe_id, f"it belongs to {owner}, choose another id")
    connection.execute(recipes.delete().where(recipes.c.recipe_id == recipe.recipe_id))
    connection.execute(
        recipes.insert().values(
            recipe_id=recipe.recipe_id,
            skill_name=recipe.skill_name,
            content=recipe.to_json(),
            changed_at=now(),
            changed_by=actor,
        )
    )


def check_parameters(recipe: Recipe, description: SkillDescription) -> None:
    """Raise InvalidValue if the recipe sets a process parameter the skill has not, or not in its range."""
    known = {parameter.name: parameter for parameter in description.parameters}
    for name, value in recipe.parameters.items():
        if name not in known:
            there = ", ".join(sorted(known)) or "none"
            raise InvalidValue(f"parameters.{name}", value, f"{description.name} has no such parameter, it has {there}")
        known[name].check(value)


def find(connection: sql.Connection, recipe_id: str) -> Recipe | None:
    """Return a recipe, if there is one with that id."""
    content = connection.scalar(sql.select(recipes.c.content).where(recipes.c.recipe_id == recipe_id))
    if content is None:
        return None
    with stored(f"recipe {recipe_id}"):
        return Recipe.from_json(content)


def read(connection: sql.Connection, recipe_id: str) -> Recipe:
    """Return a recipe, or raise NotFound."""
    recipe = find(connection, recipe_id)
    if recipe is None:
        raise NotFound("recipe", recipe_id)
    return recipe


def of_skill(connection: sql.Connection, skill_name: str) -> list[Recipe]:
    """Return the recipes of a skill, or of all skills for "", in the order of their ids."""
    if skill_name:
        versions.number(connection, skill_name, 0)
    query = sql.select(recipes.c.recipe_id, recipes.c.content).order_by(recipes.c.recipe_id)
    if skill_name:
        query = query.where(recipes.c.skill_name == skill_name)
    found: list[Recipe] = []
    for row in connection.execute(query):
        with stored(f"recipe {row.recipe_id}"):
            found.append(Recipe.from_json(row.content))
    return found


def delete(connection: sql.Connection, recipe_id: str) -> None:
    """Delete a recipe, unless it is a skill's default or a job that has not ended names it."""
    owner, what = _skill_of(connection, recipe_id), f"recipe {recipe_id}"
    if owner is None:
        raise NotFound("recipe", recipe_id)
    if connection.scalar(sql.select(skills.c.name).where(skills.c.default_recipe_id == recipe_id)):
        raise InUse(what, f"as the default of {owner}", "change it instead")
    waiting = sql.select(jobs.c.job_id).where(jobs.c.recipe_id == recipe_id, jobs.c.state.not_in(FINAL_JOB_STATES))
    job_id = connection.scalar(waiting.limit(1))
    if job_id is not None:
        raise InUse(what, f"by job {job_id}", "wait for its end or abort it")
    connection.execute(recipes.delete().where(recipes.c.recipe_id == recipe_id))


def _skill_of(connection: sql.Connection, recipe_id: str) -> str | None:
    """Return whose recipe it is, also of one that cannot be read: it can still be replaced or deleted."""
    return connection.scalar(sql.select(recipes.c.skill_name).where(recipes.c.recipe_id == recipe_id))


def free_id(connection: sql.Connection, name: str) -> str:
    """Return an id for the default recipe of a new skill that no recipe has."""
    candidates: Iterable[str] = (f"{name}-default{suffix}" for suffix in ("", *(f"-{n}" for n in range(2, 1000))))
    taken = sql.select(recipes.c.recipe_id).where(recipes.c.recipe_id.startswith(f"{name}-default", autoescape=True))
    there = set(connection.scalars(taken))
    found = next((candidate for candidate in candidates if candidate not in there), None)
    if found is None or len(found) > MAX_RECIPE_ID:
        raise AlreadyExists("recipe", f"{name}-default")
    return found

"""`recipes …`: how one product wants a skill run, from and to files."""

import json
import tomllib
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic.alias_generators import to_snake

from opcua_skill.client import Recipe, Skill, SkillClient
from opcua_skill.commands.options.client import DEFAULT_SERVER, Json, On, Output, Server, User, Version, with_client
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.fields import made_of
from opcua_skill.commands.terminal.output import plain, print_json, say, show_table, table

app = typer.Typer(no_args_is_help=True, help="Recipes: time step, speed, frame and heights of a run.")
RecipeId = Annotated[str, typer.Argument(metavar="ID", help="id of the recipe")]


def recipe_from(file: Path) -> Recipe:
    """Return the recipe in a JSON or TOML file; a fault names the file, the field and what it should be."""
    try:
        text = file.read_text(encoding="utf-8")
        values: Any = tomllib.loads(text) if file.suffix.lower() == ".toml" else json.loads(text)
    except (ValueError, tomllib.TOMLDecodeError) as error:
        raise Fault(f"{file} is neither TOML nor JSON: {error}") from None
    if not isinstance(values, dict):
        raise Fault(f"{file} holds no recipe: write one field a line, such as time_step = 0.004")
    try:
        return made_of(Recipe, {to_snake(name): value for name, value in values.items()})
    except ValueError as error:
        raise Fault(f"{file}: {error}") from None


@app.command("list")
def list_recipes(
    skill: Annotated[str, typer.Option(help="only of this skill")] = "",
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """List recipes."""
    found = with_client(server, user, lambda client: client.recipes(skill))
    if as_json:
        print_json(found)
        return
    rows = [
        (
            one.recipe_id,
            one.skill_name,
            one.skill_version or "deployed",
            f"{one.time_step * 1000:g}",
            one.timing,
            one.product,
        )
        for one in found
    ]
    show_table(table("", ("=recipe", "=skill", "version", ">time step, ms", "timing", "product"), rows))


@app.command()
def show(recipe_id: RecipeId, server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False) -> None:
    """Show a recipe; with --json in the form that `put` reads."""
    found = with_client(server, user, lambda client: client.recipe(recipe_id))
    if as_json:
        print_json(found)
    else:
        show_table(table(recipe_id, ("field", "value"), plain(found).items()))


@app.command()
def put(
    file: Annotated[
        Path, typer.Argument(exists=True, dir_okay=False, help="TOML or JSON file with the recipe's fields")
    ],
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Store a recipe, or replace the one of that id."""
    recipe = recipe_from(file)
    with_client(server, user, lambda client: client.put_recipe(recipe))
    if as_json:
        print_json(recipe)
    else:
        say(f"recipe {recipe.recipe_id} is stored")


class Picture(StrEnum):
    """What is drawn."""

    ARM = "arm"
    WORK = "work"
    CARD = "card"


@app.command()
def picture(
    recipe_id: RecipeId,
    output: Output,
    view: Annotated[Picture, typer.Option(help="the arm, the nozzle at work, or the operator's card")] = Picture.CARD,
    arm: Annotated[str, typer.Option(metavar="NAME", help="the arm that is to run it")] = "panda",
    version: Version = 0,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Plan a run of a recipe here and draw it: the path to scale, and the arm at work."""
    from opcua_skill.commands.terminal.drawing import drawn

    async def work(client: SkillClient) -> tuple[Recipe, Skill]:
        recipe = await client.recipe(recipe_id)
        return recipe, await client.skill(recipe.skill_name, version or recipe.skill_version)

    recipe, skill = with_client(server, user, work)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_bytes(drawn(skill, recipe, arm, view.value))
    if as_json:
        print_json({"file": output})
    else:
        say(f"wrote {output}")


async def _meant(client: SkillClient, recipe: Recipe, version: int) -> Skill:
    """Return the version asked for, or the recipe's own; else the newest that is deployed, or the newest of all."""
    newest = await client.skill(recipe.skill_name, version or recipe.skill_version)
    if version or recipe.skill_version:
        return newest
    older = newest
    while not older.document.get("workstations"):
        if older.version == 1:
            return newest
        older = await client.skill(recipe.skill_name, older.version - 1)
    return older


class Spoken(StrEnum):
    """The languages that programs are written in."""

    URSCRIPT = "urscript"
    KRL = "krl"
    RAPID = "rapid"
    LS = "ls"
    GCODE = "gcode"


@app.command()
def program(
    recipe_id: RecipeId,
    language: Annotated[Spoken, typer.Option("--for", help="the controller's language")],
    output: Output,
    arm: Annotated[str, typer.Option(metavar="NAME", help="the arm that is to run it, or its folder")] = "panda",
    config: Annotated[
        Path | None, typer.Option(exists=True, dir_okay=False, help="take arm and cell from a workstation of this file")
    ] = None,
    on: On = "",
    tolerance: Annotated[float, typer.Option(help="the most by which the path may be off, m")] = 5e-5,
    turn_tolerance: Annotated[float, typer.Option(help="the most by which the tool may lean off, rad")] = 2e-3,
    name: Annotated[str, typer.Option(metavar="NAME", help="the program's name on the controller")] = "skill",
    valve: Annotated[int, typer.Option(min=0, max=4096, help="digital output of the valve")] = 1,
    tool: Annotated[int, typer.Option(min=1, max=99, help="the controller's number of the tool's tip")] = 1,
    version: Annotated[
        int, typer.Option(min=0, help="version of the skill; 0 is the recipe's, or the deployed one")
    ] = 0,
    server: Server = DEFAULT_SERVER,
    user: User = "",
    as_json: Json = False,
) -> None:
    """Write a recipe as a program for a closed controller; it is read back and compared with its plan first."""
    from opcua_skill.commands.programming import place_of, programmed
    from opcua_skill.programs.values import Options

    async def work(client: SkillClient) -> tuple[Recipe, Skill]:
        recipe = await client.recipe(recipe_id)
        return recipe, await _meant(client, recipe, version)

    place = place_of(arm, config, on)
    recipe, skill = with_client(server, user, work)
    options = Options(tolerance, turn_tolerance, name, valve, tool)
    text, found, spoken = programmed(skill, recipe, place, language.value, options)
    output.parent.mkdir(parents=True, exist_ok=True)
    output.write_text(text, encoding="ascii")
    if as_json:
        print_json({"file": output, "language": spoken.name, "limits": spoken.limits, **plain(found)})
    else:
        say(
            f"wrote {output}: {found.lines} lines, off the plan by up to {1e3 * found.path:.4f} mm, "
            f"{1e3 * found.duration:.2f} ms longer or shorter, the valve {1e3 * found.switching:.2f} ms"
        )


@app.command()
def delete(recipe_id: RecipeId, server: Server = DEFAULT_SERVER, user: User = "", as_json: Json = False) -> None:
    """Delete a recipe."""
    with_client(server, user, lambda client: client.delete_recipe(recipe_id))
    if as_json:
        print_json({"recipe_id": recipe_id})
    else:
        say(f"recipe {recipe_id} is deleted")

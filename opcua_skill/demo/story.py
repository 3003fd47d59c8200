"""The main job: people show, an engineer approves, an MES orders, the arm runs. Every step is an OPC UA client's."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from models.demonstration import Demonstration
from opcua_skill.client import JobReport, JobTrace, LearningOptions, Recipe, Skill, SkillClient
from opcua_skill.demo.plant import Plant

SKILL = "glue-plate"
SEMANTIC_TYPE = "Gluing"
STATION = "ws1"
PRESETS = ("paper", "recommended")
TRACKING_LIMIT = 0.0001
RUN_LIMIT = 300.0
OnStep = Callable[[str, float], None]


class StepFailed(Exception):
    """The story ended otherwise than it has to; the message says what did not hold."""


@dataclass(frozen=True, slots=True)
class Ran:
    """One recipe as the arm ran it."""

    recipe: Recipe
    report: JobReport
    trace: JobTrace


@dataclass(frozen=True, slots=True)
class Outcome:
    """What the story came to. ``skills``: the version learned with each preset; ``chosen``: the better preset."""

    skills: Mapping[str, Skill]
    chosen: str
    runs: Sequence[Ran]
    seconds_to_first_run: float

    def path_error(self, preset: str) -> float:
        """Return RMS of learned path against the mean of the aligned demonstrations, in m, as the report says."""
        return float(self.skills[preset].report["path_error"]["rms"])


async def main_story(plant: Plant, demonstrations: Sequence[Demonstration], on_step: OnStep) -> Outcome:
    """Play the story once; ``on_step`` hears what happens now and how far that is, 0 to 1."""
    async with (
        plant.sign_in("teacher") as teacher,
        plant.sign_in("engineer") as engineer,
        plant.sign_in("mes") as mes,
    ):
        began = time.monotonic()
        skills = {preset: await teach(teacher, preset, demonstrations, on_step) for preset in PRESETS}
        chosen = min(PRESETS, key=lambda preset: skills[preset].report["path_error"]["rms"])
        on_step(f"the engineer approves and deploys {chosen}", 0.0)
        recipes = await release(engineer, skills[chosen])
        orders = [(recipe, await order(mes, recipe)) for recipe in recipes]
        runs: list[Ran] = []
        first = 0.0
        for recipe, job_id in orders:
            report = await watch(mes, recipe, job_id, on_step)
            first = first or time.monotonic() - began
            runs.append(Ran(recipe, report, await mes.workstation(STATION).trace(job_id)))
    held(runs)
    return Outcome(skills, chosen, runs, first)


async def teach(teacher: SkillClient, preset: str, demonstrations: Sequence[Demonstration], on_step: OnStep) -> Skill:
    """Send the demonstrations with one preset; return the version learned from them."""
    doing = f"learning, {preset} preset"
    on_step(doing, 0.0)
    options = LearningOptions(preset="paper" if preset == "paper" else "recommended")
    report = await teacher.learn_to_the_end(
        SKILL,
        demonstrations,
        semantic_type=SEMANTIC_TYPE,
        options=options,
        on_progress=lambda job: on_step(doing, job.progress),
    )
    if report.state != "Completed":
        raise StepFailed(f"learning with the {preset} preset ended {report.state}: {report.message or report.failure}")
    return await teacher.skill(SKILL, report.skill_version)


async def release(engineer: SkillClient, skill: Skill) -> tuple[Recipe, Recipe]:
    """Approve exactly this model, deploy it, and store a recipe for each of two products."""
    await engineer.approve(skill.name, skill.version, skill.model_digest, "smaller path error in the quality report")
    await engineer.deploy(skill.name, skill.version, STATION)
    [default, *_] = await engineer.recipes(skill.name)
    recipes = (
        replace(default, recipe_id="frame-a", product="frame A", time_step=0.008, timing="demonstrated"),
        replace(
            default,
            recipe_id="frame-b",
            product="frame B",
            time_step=0.004,
            timing="constant_speed",
            speed=0.025,
        ),
    )
    for recipe in recipes:
        await engineer.put_recipe(recipe)
    return recipes


async def order(mes: SkillClient, recipe: Recipe) -> str:
    """Order one run in production; return its job."""
    started = await mes.workstation(STATION).execute(recipe.skill_name, recipe_id=recipe.recipe_id, mode="production")
    return started.job_id


async def watch(mes: SkillClient, recipe: Recipe, job_id: str, on_step: OnStep) -> JobReport:
    """Follow a job to its end; return its report."""
    doing = f"the arm runs recipe {recipe.recipe_id}"
    return await mes.follow(job_id, on=STATION, limit=RUN_LIMIT, on_progress=lambda job: on_step(doing, job.progress))


def held(runs: Sequence[Ran]) -> None:
    """Raise unless every run ended well, tracked its path, and differed from the other in its time steps."""
    for run in runs:
        if run.report.state != "Completed":
            raise StepFailed(
                f"recipe {run.recipe.recipe_id} ended {run.report.state}: {run.report.message or run.report.failure}"
            )
        if not run.report.tracking_error[0] <= TRACKING_LIMIT:
            raise StepFailed(
                f"recipe {run.recipe.recipe_id}: the arm was {run.report.tracking_error[0] * 1000:.3f} mm (RMS) off"
            )
    if len({run.report.samples for run in runs}) < len(runs):
        raise StepFailed("both recipes gave the same number of time steps")

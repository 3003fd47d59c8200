"""A database in which a skill is learned, approved and deployed, made once."""

import asyncio
import tempfile
from functools import lru_cache
from pathlib import Path

from small_corner import small_corner

from library.recipe import Recipe
from library.store import SkillLibrary
from models.demonstration import Edits
from models.learning import learn
from models.options import LearningOptions
from sim.robots import load


@lru_cache(maxsize=1)
def seed() -> bytes:
    """Return a database with a skill that is deployed."""

    async def make(file: Path) -> None:
        people = small_corner(3)
        async with await SkillLibrary.open(file) as library:
            made = await library.add_version(
                name="glue",
                semantic_type="Gluing",
                required_atomic_skills=(),
                recordings=people,
                edits=Edits(),
                options=LearningOptions(),
                learned=learn(people),
                actor="tina",
                job_id=None,
                default_recipe=Recipe(recipe_id="glue-default", skill_name="glue", frame=load("panda").part_frame),
            )
            await library.approve("glue", 1, bytes.fromhex(made.model_digest), "eve")
            await library.deploy("glue", 1, "ws1", "eve")

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "skills.db"
        asyncio.run(make(file))
        return file.read_bytes()

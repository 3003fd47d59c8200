"""The digest and the published schema of a skill description."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from library.description import (
    Parameter,
    Provenance,
    SkillDescription,
    VersionState,
    description_schema,
    model_digest,
)
from library.errors import InvalidValue

PUBLISHED = Path(__file__).parents[2] / "docs" / "reference" / "skill-description.schema.json"
IDENTITY = np.array([np.eye(4)] * 2)
SEMANTIC: dict[str, Any] = {
    "means": np.arange(8.0).reshape(2, 4),
    "covariances": IDENTITY,
    "semantic_type": "urn:example:Gluing",
    "required_atomic_skills": ("FollowPath", "Dispense"),
    "dimension": 2,
    "frame": "part",
    "clock": "path",
    "duration": 5.0,
    "time_step": 0.01,
    "covariance_rule": "within",
    "dispense": ((0.1, 0.9),),
    "parameters": (Parameter(name="pressure", unit="bar", default=2.0, minimum=0.0, maximum=6.0),),
}


def description(**changes: Any) -> SkillDescription:
    given_fields: dict[str, Any] = {
        **SEMANTIC,
        "name": "glue",
        "version": 1,
        "state": VersionState.LEARNED,
        "model_digest": model_digest(**SEMANTIC),
        "provenance": Provenance(taught_by="tina", taught_at="2026-01-01T00:00:00Z"),  # pyright: ignore[reportArgumentType]
        **changes,
    }
    for key in ("means", "covariances"):
        if isinstance(given_fields[key], np.ndarray):
            given_fields[key] = given_fields[key].tolist()
    return SkillDescription(**given_fields)


def test_the_published_schema_is_the_one_of_the_code() -> None:
    assert json.loads(PUBLISHED.read_text(encoding="utf-8")) == description_schema()


def test_the_keys_clients_rely_on_are_in_the_schema() -> None:
    keys = description_schema()["properties"]
    promised = (
        "name",
        "version",
        "semanticType",
        "state",
        "modelDigest",
        "requiredAtomicSkills",
        "means",
        "covariances",
    )
    assert set(promised) <= set(keys)
    assert set(json.loads(description().to_json())) == set(keys)


OTHER: dict[str, Any] = {
    "means": np.nextafter(SEMANTIC["means"], 9.0),
    "covariances": IDENTITY * np.nextafter(1.0, 2.0),
    "semantic_type": "urn:example:Welding",
    "required_atomic_skills": ("Dispense", "FollowPath"),
    "dimension": 3,
    "frame": "plate",
    "clock": "time",
    "duration": np.nextafter(5.0, 6.0),
    "time_step": 0.02,
    "covariance_rule": "paper",
    "dispense": ((0.1, 0.5), (0.5, 0.9)),
    "parameters": (),
}


@pytest.mark.parametrize("part", sorted(OTHER))
def test_the_digest_covers_every_part_of_the_model(part: str) -> None:
    assert model_digest(**{**SEMANTIC, part: OTHER[part]}) != model_digest(**SEMANTIC)


def test_the_digest_does_not_depend_on_who_when_name_or_state() -> None:
    one = description()
    other = description(
        name="bond",
        version=7,
        state=VersionState.RETIRED,
        workstations=("ws1",),
        provenance=Provenance(taught_by="otto", taught_at="2027-01-01T00:00:00Z"),  # pyright: ignore[reportArgumentType]
        report={"any": 1},
    )
    assert one.computed_digest() == other.computed_digest() == one.model_digest


def test_the_digest_can_be_computed_as_the_reference_page_says() -> None:
    page = (PUBLISHED.parent / "skill-description.md").read_text(encoding="utf-8")
    code = page.split("```python\n")[1].split("```")[0]
    names: dict[str, Any] = {}
    exec(code, names)
    skill = description()
    assert names["digest"](skill.to_json()) == skill.model_digest
    assert names["digest"](skill.model_copy(update={"frame": "plate"}).to_json()) != skill.model_digest


BROKEN = [
    ({"means": []}, "means"),
    ({"means": [[1.0, 2.0, 3.0]] * 2}, "means"),
    ({"means": [[1.0, 2.0, 3.0, 4.0], [1.0]]}, "means"),
    ({"means": [[1.0, 2.0, 3.0, float("nan")]] * 2}, "means"),
    ({"covariances": IDENTITY[:1]}, "covariances"),
    ({"covariances": IDENTITY[:, :3]}, "covariances"),
    ({"covariances": -IDENTITY}, "means"),
    ({"covariances": IDENTITY + np.triu(np.ones((4, 4)), 1)}, "covariances"),
    ({"covariances": IDENTITY * [1.0, -1.0, 1.0, 1.0]}, "covariances"),
    ({"dimension": 4}, "dimension"),
    ({"clock": "sun"}, "clock"),
    ({"duration": 0.0}, "duration"),
    ({"duration": float("inf")}, "duration"),
    ({"dispense": ((0.5, 0.4),)}, "dispense"),
    ({"dispense": ((0.0, 0.6), (0.5, 0.9))}, "dispense"),
    ({"dispense": ((0.0, 1.1),)}, "dispense"),
    ({"version": 0}, "version"),
    ({"model_digest": "xyz"}, "model_digest"),
    ({"parameters": SEMANTIC["parameters"] * 2}, "parameters"),
    ({"schema_version": 2}, "schema_version"),
    ({"priors": [0.5, 0.5]}, "priors"),
]


@pytest.mark.parametrize(("changes", "field"), BROKEN, ids=lambda value: str(value)[:50])
def test_a_description_that_is_no_skill_is_refused_by_field(changes: dict[str, Any], field: str) -> None:
    with pytest.raises(InvalidValue) as refusal:
        description(**changes)
    assert refusal.value.field.startswith(field)


@given(text=st.text(), cut=st.integers(min_value=0, max_value=2000))
@settings(deadline=None)
def test_any_other_text_is_refused_in_one_sentence(text: str, cut: int) -> None:
    whole = description().to_json()
    for broken in (text, whole[: cut % len(whole)]):
        with pytest.raises(InvalidValue) as refusal:
            SkillDescription.from_json(broken)
        assert "\n" not in str(refusal.value)


LEARN = """
from models.demonstration import Edits
from models.learning import learn
from models.options import LearningOptions
from models.synthetic import simulated_people
from library.queries.learned import prepare

people, _ = simulated_people(4, seed=3)
for options in (LearningOptions(), LearningOptions(preset="paper")):
    made = prepare(
        name="glue", semantic_type="urn:example:Gluing", required_atomic_skills=("FollowPath",), demonstrations=people,
        edits=Edits(), options=options, learned=learn(people, Edits(), options), actor=ACTOR, based_on=None,
        parameters=(), frame="part",
    )
    print(made.description.model_digest)
"""


def test_the_same_recordings_and_options_give_the_same_digest_in_another_process() -> None:
    path = os.pathsep.join(filter(None, sys.path))
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", LEARN.replace("ACTOR", repr(actor))],
            env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": str(seed), "OMP_NUM_THREADS": str(seed)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for seed, actor in enumerate(("tina", "otto"), 1)
    ]
    first, second = [process.communicate(timeout=150)[0].split() for process in processes]
    assert [process.returncode for process in processes] == [0, 0]
    assert first == second
    assert len(set(first)) == 2


async def test_what_people_showed_comes_out_of_the_library_as_the_same_path(library: Any, teach: Any) -> None:
    from models.learning import learn
    from models.synthetic import simulated_people

    people, _ = simulated_people(4, seed=5)
    learned = learn(people)
    stored = await teach(library, recordings=people, learned=learned)
    before = learned.motion.as_learned()
    after = (await library.description("glue")).motion().as_learned()
    for part in ("times", "phases", "points", "covariances"):
        assert getattr(before, part).tobytes() == getattr(after, part).tobytes()
    assert len(stored.verdicts) == len(people)
    again = learn(await library.recordings("glue"), await library.edits("glue"), await library.options("glue"))
    assert again.motion.means.tobytes() == learned.motion.means.tobytes()
    aligned = await library.aligned("glue")
    for stored_one, learned_one in zip(aligned, learned.aligned, strict=True):
        assert stored_one.points.tobytes() == learned_one.points.tobytes()
        assert stored_one.phases.tobytes() == learned_one.phases.tobytes()

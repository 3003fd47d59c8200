"""Small hand-made values, and a library in a folder of its own."""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from library.description import Parameter, SkillDescription
from library.store import SkillLibrary
from models.demonstration import Demonstration, Edits
from models.motion import Motion
from models.options import LearningOptions
from models.report import AlignedDemonstration, LearnedMotion, LearningReport, Verdict, VerdictKind
from tests import postgres

PRESSURE = Parameter(name="pressure", unit="bar", default=2.0, minimum=0.0, maximum=6.0)


def make_demonstration(name: str = "d1", samples: int = 40, dimension: int = 2, shift: float = 0.0) -> Demonstration:
    """Return a short stroke with one lost marker."""
    times = np.arange(samples) * 0.01
    points = np.column_stack([np.sin(times + axis) * 0.03 + shift for axis in range(dimension)])
    points[3] = np.nan
    return Demonstration(
        demonstration_id=name,
        times=times,
        points=points,
        triggers=times > 0.05,
        operator="anna",
        source="tracker 7",
        recorded_at=datetime(2026, 3, 1, 12, 0, tzinfo=UTC),
    )


def make_motion(seed: int = 0, components: int = 3) -> Motion:
    """Return a motion over the path with arbitrary, valid numbers."""
    generator = np.random.default_rng(seed)
    roots = generator.normal(size=(components, 4, 4))
    return Motion(
        means=generator.normal(size=(components, 4)),
        covariances=roots @ roots.transpose(0, 2, 1),
        clock="path",
        dimension=2,
        duration=5.25,
        dispense=((0.1, 0.4), (0.5, 0.9)),
        time_step=0.01,
        covariance_rule="within",
    )


def make_learned(recordings: Sequence[Demonstration], motion: Motion | None = None) -> LearnedMotion:
    """Return what learning would hand over, with made-up numbers."""
    motion = motion or make_motion()
    verdicts = tuple(Verdict(one.demonstration_id, VerdictKind.USED, "as shown", 0.5, 0.001, "") for one in recordings)
    aligned = tuple(
        AlignedDemonstration(
            one.demonstration_id,
            np.linspace(0.0, 1.0, len(one.times)),
            np.linspace(0.0, 5.0, 9),
            np.zeros((9, one.dimension)),
            np.ones(9, dtype=bool),
        )
        for one in recordings
    )
    report = LearningReport(
        preset="recommended",
        components=len(motion.means),
        clock=motion.clock,
        duration=motion.duration,
        length=0.2,
        path_error={"rms": 0.0004, "max": 0.0011},
        demonstrations=(),
        repeatability_phases=(0.0, 1.0),
        repeatability=(0.001, 0.002),
        smoothness=float("-inf"),
        verdicts=verdicts,
        covariance_rule=motion.covariance_rule,
    )
    return LearnedMotion(motion, verdicts, aligned, report)


async def teach(library: SkillLibrary, name: str = "glue", *, actor: str = "tina", **changes: Any) -> SkillDescription:
    """Store a version, with whatever the test wants to be different."""
    recordings = changes.pop("recordings", [make_demonstration("d1"), make_demonstration("d2", shift=0.001)])
    given: dict[str, Any] = {
        "name": name,
        "semantic_type": "urn:example:Gluing",
        "required_atomic_skills": ("FollowPath", "Dispense"),
        "recordings": recordings,
        "edits": Edits(),
        "options": LearningOptions(),
        "learned": make_learned(recordings, changes.pop("motion", None)),
        "actor": actor,
        "job_id": None,
        "parameters": (PRESSURE,),
    }
    return await library.add_version(**{**given, **changes})


Teach = Callable[..., Any]


@pytest.fixture
def database_file(tmp_path: Path) -> Path:
    """Where the library of this test lies."""
    return tmp_path / "data" / "library.sqlite"


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """What is asked of a library is asked on both engines, unless a test looks into the file of one."""
    if "library" in metafunc.fixturenames and "database_file" not in metafunc.fixturenames:
        engines = ["sqlite", "postgresql"] if postgres.available() else ["sqlite"]
        metafunc.parametrize("engine", engines, indirect=True)


@pytest.fixture(scope="session")
def cluster() -> Iterator[postgres.Cluster]:
    """A PostgreSQL server with a prepared database to make others from."""
    with postgres.cluster() as running:
        with ThreadPoolExecutor(1) as beside_the_loop:  # of the test that asks for it first
            beside_the_loop.submit(asyncio.run, postgres.prepare_template(running)).result()
        yield running


@pytest.fixture
async def engine(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where the library of this test is: a file, unless a test asks for more."""
    if getattr(request, "param", "sqlite") == "sqlite":
        return str(tmp_path / "data" / "library.sqlite")
    cluster: postgres.Cluster = request.getfixturevalue("cluster")
    await cluster.empty("template_library")  # a database of its own for each test would be 8 MB of files each
    return cluster.url("template_library")


@pytest.fixture
async def library(engine: str) -> AsyncIterator[SkillLibrary]:
    """An empty library, open."""
    async with await SkillLibrary.open(engine) as opened:
        yield opened


@pytest.fixture(scope="session", name="teach")
def teach_fixture() -> Teach:
    """The function that stores a version."""
    return teach


@pytest.fixture(scope="session", name="make_demonstration")
def make_demonstration_fixture() -> Teach:
    """The function that makes a stroke."""
    return make_demonstration


@pytest.fixture(scope="session", name="make_motion")
def make_motion_fixture() -> Teach:
    """The function that makes a motion."""
    return make_motion


@pytest.fixture(scope="session", name="make_learned")
def make_learned_fixture() -> Teach:
    """The function that makes a learned motion."""
    return make_learned

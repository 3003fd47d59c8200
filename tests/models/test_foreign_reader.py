"""A program in another language gets the same path from an exported skill."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from models.learning import LearningOptions, learn
from models.motion import Motion
from models.synthetic import ZIGZAG_IN_SPACE, simulated_people

READERS = Path(__file__).parents[2] / "docs" / "reference" / "learning"


def exported(motion: Motion) -> str:
    """Return the keys of an exported skill that a reader needs, among others."""
    return json.dumps(
        {
            "schemaVersion": 1,
            "name": 'a "clock": [skill',
            "options": {"clock": "time", "means": [1.0]},
            "dimension": motion.dimension,
            "clock": motion.clock,
            "duration": motion.duration,
            "means": motion.means.tolist(),
            "covariances": motion.covariances.tolist(),
        },
        indent=1,
    )


@pytest.fixture(scope="module")
def learned() -> dict[str, Motion]:
    """Return a motion of each kind."""
    flat, deep = simulated_people(4, 1)[0], simulated_people(4, 2, corners=ZIGZAG_IN_SPACE, orientation=True)[0]
    return {
        "over the path": learn(flat).motion,
        "over time": learn(flat, options=LearningOptions(preset="paper")).motion,
        "in space, with orientation": learn(deep).motion,
    }


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """How each reader is run, as its own first lines say: compiled, or as it is."""
    binary = tmp_path_factory.mktemp("reader") / "skill_path"
    warnings = ["-std=c99", "-Wall", "-Wextra", "-Werror"]
    command = ["cc", "-O2", *warnings, "-o", str(binary), str(READERS / "skill_path.c"), "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    return {"JavaScript": ["node", str(READERS / "skill_path.js")], "C": [str(binary)]}


@pytest.mark.parametrize("kind", ["over the path", "over time", "in space, with orientation"])
@pytest.mark.parametrize("language", ["JavaScript", "C"])
def test_another_language_reads_the_same_path(
    language: str, kind: str, learned: dict[str, Motion], commands: dict[str, list[str]], tmp_path: Path
) -> None:
    motion, phases = learned[kind], np.linspace(0.0, 1.0, 501)
    file = tmp_path / "skill.json"
    file.write_text(exported(motion))
    run = subprocess.run([*commands[language], str(file), "501"], check=True, capture_output=True, text=True)
    head, *lines = run.stdout.splitlines()
    rows = np.loadtxt(lines, delimiter=",")
    last = 2 + motion.dimension
    assert head.split(",")[: 2 + motion.dimension] == ["phase", "t_s", "x_m", "y_m", "z_m"][:last]
    np.testing.assert_allclose(rows[:, 0], phases, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(rows[:, 2:last], motion.points_at(phases), rtol=0.0, atol=1e-12)
    if motion.has_orientation:
        np.testing.assert_allclose(rows[:, last:], motion.orientations_at(phases), rtol=0.0, atol=1e-12)
    else:
        assert rows.shape[1] == last


def test_the_reader_names_only_keys_that_an_exported_skill_has() -> None:
    schema = json.loads((READERS.parent / "skill-description.schema.json").read_text())
    assert {"means", "covariances", "clock", "dimension", "duration"} <= set(schema["properties"])

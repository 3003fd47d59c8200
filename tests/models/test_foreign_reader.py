"""A program in another language gets the same path from an exported skill."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from models.learning import LearningOptions, learn
from models.motion import Motion
from models.people import ZIGZAG_IN_SPACE, simulated_people

SOURCE = Path(__file__).parents[2] / "docs" / "reference" / "learning" / "skill_path.c"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


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


def motions() -> dict[str, Motion]:
    """Return a motion of each kind."""
    flat, deep = simulated_people(4, 1)[0], simulated_people(4, 2, corners=ZIGZAG_IN_SPACE, orientation=True)[0]
    return {
        "over the path": learn(flat).motion,
        "over time": learn(flat, options=LearningOptions(preset="paper")).motion,
        "in space": learn(deep).motion,
    }


if COMPILER:

    @pytest.fixture(scope="module")
    def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
        """The documented reader, compiled as its first lines say."""
        binary = tmp_path_factory.mktemp("reader") / "skill_path"
        command = [COMPILER, "-O2", "-Wall", "-Wextra", "-Werror", "-o", str(binary), str(SOURCE), "-lm"]
        subprocess.run([str(word) for word in command], check=True, capture_output=True)
        return binary

    @pytest.mark.parametrize("kind", ["over the path", "over time", "in space"])
    def test_the_c_reader_prints_the_same_path(program: Path, kind: str, tmp_path: Path) -> None:
        motion = motions()[kind]
        file = tmp_path / "skill.json"
        file.write_text(exported(motion))
        printed = subprocess.run([str(program), str(file), "501"], check=True, capture_output=True, text=True).stdout
        rows = np.loadtxt(printed.splitlines(), delimiter=",", skiprows=1)
        np.testing.assert_allclose(rows[:, 2:], motion.points_at(np.linspace(0.0, 1.0, 501)), atol=1e-12)


def test_the_reader_names_only_keys_that_an_exported_skill_has() -> None:
    schema = json.loads((SOURCE.parents[1] / "skill-description.schema.json").read_text())
    assert {"means", "covariances", "clock", "dimension", "duration"} <= set(schema["properties"])

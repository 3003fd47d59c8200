"""Pictures are drawn from what a client holds, in two dimensions and three, whole or with gaps."""

from pathlib import Path as FilePath

import numpy as np
import pytest
from PIL import Image

from models.demonstration import Demonstration
from opcua_skill.client import JobTrace, Path, Recordings, Skill
from opcua_skill.figures import Run, View, components, learning_figure, normals_along, runs_figure


def view(dimension: int, clock: str) -> View:
    columns = dimension + (2 if clock == "path" else 1)
    means = np.linspace(0.0, 0.06, 3 * columns).reshape(3, columns)
    document = {
        "name": "a",
        "version": 1,
        "semanticType": "Gluing",
        "state": "Learned",
        "modelDigest": "00",
        "requiredAtomicSkills": [],
        "means": means.tolist(),
        "covariances": [(np.eye(columns) * 1e-5).tolist()] * 3,
        "clock": clock,
    }
    times = np.linspace(0, 2, 50)
    points = np.column_stack([times, np.abs(times - 1), times][:dimension]) * 0.03
    gap = points.copy()
    gap[-10:] = np.nan
    shown = tuple(Demonstration(name, times, place, np.ones(50, bool)) for name, place in (("a", points), ("b", gap)))
    path = Path(times, points, np.tile(np.eye(dimension) * 1e-6, (50, 1, 1)), times > 0.5)
    return View("a", Skill.from_document(document), Recordings(shown, shown), path)


@pytest.mark.parametrize(("dimension", "clock"), [(2, "path"), (2, "time"), (3, "path")])
def test_figure_3_is_drawn(dimension: int, clock: str, tmp_path: FilePath) -> None:
    file = tmp_path / "pictures" / "figure-3.png"
    learning_figure([view(dimension, clock)], file)
    with Image.open(file) as picture:
        width, height = picture.size
    assert width > 2 * height


def test_the_same_values_draw_the_same_bytes(tmp_path: FilePath) -> None:
    for name in ("a.png", "b.png"):
        learning_figure([view(2, "path")], tmp_path / name)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_commanded_and_measured_are_drawn(tmp_path: FilePath) -> None:
    times = np.linspace(0, 1, 20)
    commanded = np.column_stack([times, times**2, 0 * times])
    learned = [Run(name, JobTrace(times, commanded, commanded + 1e-5)) for name in ("one", "two")]
    runs_figure(learned, tmp_path / "runs.png")
    with Image.open(tmp_path / "runs.png") as picture:
        assert picture.size[0] > 800


@pytest.mark.parametrize(("clock", "first"), [("path", 2), ("time", 1)])
def test_ellipses_stand_where_the_position_columns_are(clock: str, first: int) -> None:
    skill = view(2, clock).skill
    for (mean, covariance), row in zip(components(skill), skill.means, strict=True):
        assert np.allclose(mean, row[first : first + 2] * 1000)
        assert np.allclose(covariance, np.eye(2) * 10.0)


def test_normals_are_perpendicular_and_of_length_one() -> None:
    turn = np.linspace(0, 3, 40)
    points = np.column_stack([np.cos(turn), np.sin(turn)])
    normals = normals_along(points)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1)
    assert np.allclose((normals * np.gradient(points, axis=0)).sum(axis=1), 0, atol=1e-12)
    assert not normals_along(np.zeros((5, 2))).any()

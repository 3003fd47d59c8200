"""Pictures are drawn from what a client holds, in two dimensions and three, whole or with gaps."""

from pathlib import Path as FilePath

import numpy as np
import pytest
from PIL import Image

from models.demonstration import Demonstration
from opcua_skill.client import JobTrace, Path, Recordings, Skill
from opcua_skill.client.figure_parts import normals_along
from opcua_skill.client.figures import Run, View, components, heading, learning_figure, runs_figure


def view(dimension: int, clock: str, turned: bool = False) -> View:
    columns = dimension + (2 if clock == "path" else 1) + (4 if turned else 0)
    means = np.linspace(0.001, 0.06, 3 * columns).reshape(3, columns)
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
        "dimension": dimension,
        "duration": 2.0,
        "timeStep": 0.04,
        "covarianceRule": "within",
        "verdicts": [{"demonstrationId": "b", "kind": "left out"}],
        "report": {
            "path_error": {"rms": 1e-4, "max": 3e-4},
            "end_error": {"start": 0.0, "end": 1e-5},
            "paper": {"path_error": {"rms": 3e-3, "max": 9e-3}, "end_error": {"start": 8e-3, "end": 9e-3}},
            "previous": {"version": 1, "distance": {"max": 2e-3, "point": [0.01, 0.02], "place": 0.3}},
        },
    }
    times = np.linspace(0, 2, 50)
    points = np.column_stack([times, np.abs(times - 1), times][:dimension]) * 0.03
    gap = points.copy()
    gap[-10:] = np.nan
    shown = tuple(Demonstration(name, times, place, np.ones(50, bool)) for name, place in (("a", points), ("b", gap)))
    path = Path(times, points, np.tile(np.eye(dimension) * 1e-6, (50, 1, 1)), times > 0.5)
    before = Path(times, points + 0.002, path.covariances, path.dispense)
    return View("a", Skill.from_document(document), Recordings(shown, shown), path, before)


@pytest.mark.parametrize(
    ("dimension", "clock", "turned"),
    [(2, "path", False), (2, "time", False), (2, "path", True), (3, "path", False), (3, "path", True)],
)
def test_figure_3_is_drawn(dimension: int, clock: str, turned: bool, tmp_path: FilePath) -> None:
    file = tmp_path / "pictures" / "figure-3.png"
    learning_figure([view(dimension, clock, turned), view(dimension, clock)], file)
    with Image.open(file) as picture:
        width, height = picture.size
    assert width > height


def test_what_has_to_be_known_before_signing_stands_above() -> None:
    words = heading(view(2, "path"))
    assert "digest 00" in words
    assert "path error 0.10 mm RMS" in words
    assert "the paper's preset, estimated: 3.00 and 9.00 mm" in words


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

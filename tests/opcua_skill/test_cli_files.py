"""`opcua-skill learn` with files as strangers have them: what was drawn is learned, or one sentence says why not."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from opcua_skill.commands.verbs import status_of

if TYPE_CHECKING:
    from tests.conftest import Plant

Learn = Callable[..., Any]


@pytest.fixture
def learn(plant: "Plant", monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Learn:
    """Return a function that learns from files as the teacher: what was printed, in JSON, or what was complained of."""
    monkeypatch.setenv("OPCUA_SKILL_CLIENT_DIR", str(plant.client_folder))
    monkeypatch.setenv("OPCUA_SKILL_SERVER", plant.url)
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", plant.password)

    def run(name: str, *words: object, status: int = 0) -> Any:
        capsys.readouterr()
        ended = status_of(["learn", name, *map(str, words), "--type", "Gluing", "--user", "teacher", "--json"])
        told = capsys.readouterr()
        assert ended == status, told.err
        return json.loads(told.out.splitlines()[-1]) if status == 0 else " ".join(told.err.split())

    return run


def seams(folder: Path, name: str, depth: float = 4.0) -> list[Path]:
    """Write a seam of 120 mm on a level table as five people draw it, one with a reflection and a lost marker."""
    generator = np.random.default_rng(3)
    along = np.linspace(0.0, 1.0, 240)
    files: list[Path] = []
    for person in range(5):
        points = np.column_stack([400 + 120 * along, 300 + depth * np.sin(np.pi * along), 700 + 0 * along])
        points += generator.normal(0.0, 0.1, points.shape)
        if person == 2:
            points[100, 2] += 100.0
            points[30:40] = 0.0
        rows = [f"{place / 100:.2f},{x:.2f},{y:.2f},{z:.2f}" for place, (x, y, z) in enumerate(points)]
        files.append(folder / f"{name}{person}.csv")
        files[-1].write_text("\n".join(["t_s,x_mm,y_mm,z_mm", *rows]) + "\n")
    return files


def path_of(plant: "Plant", name: str) -> np.ndarray:
    """Return the points (n, d) of the newest version in mm."""

    async def asked() -> np.ndarray:
        async with plant.sign_in("teacher") as client:
            return 1000 * (await client.path(name)).points

    return asyncio.run(asked())


def test_one_reflection_does_not_flatten_a_seam(learn: Learn, plant: "Plant", tmp_path: Path) -> None:
    learned = learn("seam", *seams(tmp_path, "seam"), "--plane")
    assert set(learned["results"].values()) == {"Good"}
    assert np.ptp(path_of(plant, "seam"), axis=0) == pytest.approx([120, 4], abs=0.5)


def test_a_straight_seam_is_not_laid_flat_by_chance(learn: Learn, tmp_path: Path) -> None:
    told = learn("straight", *seams(tmp_path, "straight", depth=0.0), "--plane", status=1)
    assert "on one line, about which it may be turned" in told
    assert "show a wider stroke, or learn them in space" in told


def drawn(person: int) -> np.ndarray:
    """Return 300 points of an arc in mm, as one of several people draws it."""
    along = np.linspace(0.0, 3.0, 300)
    hand = np.random.default_rng(person).normal(0.0, 0.1, (300, 2))
    return np.column_stack([100 + 40 * along, 200 + 30 * np.sin(along)]) + hand


def test_a_makers_file_with_lost_markers_is_learned(learn: Learn, plant: "Plant", tmp_path: Path) -> None:
    head = ["NO_OF_FRAMES\t300", "FREQUENCY\t100", "DATA_INCLUDED\t3D", "MARKER_NAMES\tTool", "Frame\tTime\tX\tY\tZ"]
    for person in range(5):
        points = np.column_stack([drawn(person), np.full(300, 50.0)])
        points[100 + person : 105 + person] = 0.0
        rows = [f"{k + 1}\t{k / 100:.3f}\t{x:.3f}\t{y:.3f}\t{z:.3f}" for k, (x, y, z) in enumerate(points)]
        (tmp_path / f"take{person}.tsv").write_text("\n".join([*head, *rows]) + "\n")
    learned = learn("qualisys", *sorted(tmp_path.glob("*.tsv")), "--plane")
    assert set(learned["results"].values()) == {"Good"}
    assert np.ptp(path_of(plant, "qualisys"), axis=0) == pytest.approx([120, 30], abs=2.0)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        (
            "mixed.csv",
            "t_ms;x_mm;y_mm\n1.010;1,5;2\n1.020;1,6;2\n",
            "line 2: column 2 holds '1,5'",
        ),
        ("quote.csv", 't_s,x_mm,y_mm\n0,"1,2\n1,2,3\n', "line 2: a quote is opened and not closed"),
        ("inch.csv", "t_s,x_in,y_in\n0,1,2\n1,2,3\n", "an inch has 25.4 mm"),
        ("turned.csv", "t,x,y,qx,qy,qz,qw\n0,0,0,0,0,0,0.7071\n1,0,0,0,0,0,1\n", "has length 0.707, not length 1"),
        (
            "six.tsv",
            "NO_OF_FRAMES\t3\nDATA_INCLUDED\t6D\nBODY_NAMES\tTool\n",
            "from Qualisys Track Manager as TSV",
        ),
        (
            "gait.qtm",
            "x",
            "files that end in .qtm; export it from there as TSV or C3D",
        ),
        ("long.c3d", "\x02\x50" + "\x01" * 2000, "it is not in Intel format"),
    ],
)
def test_what_cannot_be_read_is_one_sentence_with_the_way_out(
    learn: Learn, tmp_path: Path, name: str, content: str, words: str
) -> None:
    (tmp_path / name).write_text(content, encoding="latin-1")
    told = learn("never", tmp_path / name, status=1)
    assert words in told
    assert told.startswith("error: ") and "Traceback" not in told


USERS = ["name,role,password", "anna,teacher,correct horse battery", "ben,operator,another staple 12"]


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + "\r\n".join(USERS) + "\r\n",
        "\n".join(USERS).replace(",", ";"),
        "sep=;\n" + "\n".join(USERS).replace(",", ";") + "\n\n",
        "\n".join(USERS).replace(",", "\t"),
        "\n".join(USERS).replace("name,role", "Name, Role").replace("anna", '"anna"').replace("another", 'anot"her'),
    ],
)
def test_users_come_from_files_as_spreadsheets_save_them(
    tmp_path: Path, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "users.csv").write_text(content, encoding="utf-8")
    assert status_of(["users", "import", str(tmp_path / "users.csv"), "--data", str(tmp_path / "d"), "--json"]) == 0
    assert [one["name"] for one in json.loads(capsys.readouterr().out)] == ["anna", "ben"]


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ([USERS[0], 'anna,teacher,"correct horse'], "line 2: a quote is opened and not closed"),
        ([USERS[0], "anna;teacher;correct horse battery"], "line 2: it has 1 cell, the first line 3"),
        (["name,password", "anna,correct horse battery"], "line 1: there is no column role"),
        ([*USERS, USERS[1]], "line 4: anna stands in the file twice"),
        ([USERS[0]], "there are no users below the first line"),
    ],
)
def test_a_file_of_users_that_is_wrong_adds_nobody(
    tmp_path: Path, lines: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "users.csv").write_text("\n".join(lines))
    assert status_of(["users", "import", str(tmp_path / "users.csv"), "--data", str(tmp_path / "d")]) == 1
    assert words in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "d").exists()

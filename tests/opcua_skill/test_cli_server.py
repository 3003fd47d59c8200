"""The command line against a real server: from files to a trace, with exit status and JSON at every step."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from random_orders import ROBOTS

from library.readers.plain_csv import write
from models.synthetic import ZIGZAG_IN_SPACE, simulated_people
from opcua_skill.commands.verbs import status_of

if TYPE_CHECKING:
    from tests.conftest import Plant

Run = Callable[..., Any]


@pytest.fixture
def as_user(plant: "Plant", monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs a command with --json as a user and returns what it printed."""
    monkeypatch.setenv("OPCUA_SKILL_CLIENT_DIR", str(plant.client_folder))
    monkeypatch.setenv("OPCUA_SKILL_SERVER", plant.url)
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", plant.password)

    def run(user: str, *words: str, status: int = 0) -> Any:
        capsys.readouterr()
        ended = status_of([*words, "--user", user, "--json"])
        told = capsys.readouterr()
        assert ended == status, told.err
        return json.loads(told.out.splitlines()[-1]) if status == 0 else " ".join(told.err.split())

    return run


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    folder = tmp_path_factory.mktemp("people")
    for one in simulated_people(5)[0]:
        write(folder / f"{one.demonstration_id}.csv", one)
    return [str(file) for file in sorted(folder.glob("*.csv"))]


def test_the_whole_story_from_the_command_line(as_user: Run, files: list[str], tmp_path: Path) -> None:
    learned = as_user("teacher", "learn", "plate", *files, "--type", "Gluing", "--option", "seed=7")
    assert (learned["name"], learned["version"], learned["state"]) == ("plate", 1, "Learned")
    assert len(learned["results"]) == len(files)
    again = as_user("teacher", "learn", "plate", *files, "--option", "components=6")
    assert (again["version"], again["semantic_type"]) == (2, "Gluing")
    assert [skill["name"] for skill in as_user("visitor", "skills", "list", "--state", "Learned")] == ["plate"]
    digest = as_user("visitor", "skills", "show", "plate", "--version", "1")["modelDigest"]

    refusal = as_user("teacher", "skills", "approve", "plate", "--version", "1", status=1)
    assert "BadUserAccessDenied" in refusal
    wrong = "00" * 32
    assert "ModelDigest" in as_user(
        "engineer", "skills", "approve", "plate", "--version", "1", "--digest", wrong, status=1
    )
    approved = as_user("engineer", "skills", "approve", "plate", "--version", "1", "--digest", digest)
    assert approved["state"] == "Approved"
    as_user("engineer", "skills", "reject", "plate", "--version", "2", "--comment", "too many components")
    as_user("engineer", "skills", "deploy", "plate", "--version", "1", "--on", "ws1")

    [default] = as_user("mes", "recipes", "list", "--skill", "plate")
    assert default in as_user("mes", "recipes", "list"), "of all skills, where none is named"
    fine = tmp_path / "fine.toml"
    fine.write_text(f'recipe_id = "fine"\nskill_name = "plate"\ntime_step = 0.004\nframe = {default["frame"]}\n')
    as_user("engineer", "recipes", "put", str(fine))
    assert as_user("mes", "recipes", "show", "fine")["time_step"] == 0.004

    (tmp_path / "cell.toml").write_text(
        f'[[workstations]]\nname = "table"\narm = "{ROBOTS / "gantry"}"\ndriver = "kinematic"\n'
    )
    place = ("--config", str(tmp_path / "cell.toml"), "--on", "table", "-o", str(tmp_path / "fine.ngc"))
    made = as_user("mes", "recipes", "program", "fine", "--for", "gcode", *place)
    assert (made["path"] <= 5e-5, made["duration"] < 1e-6, made["switching"] < 1e-4) == (True, True, True)
    written = (tmp_path / "fine.ngc").read_text()
    assert f"(skill digest: {digest})" in written
    assert "(approved by: engineer)" in written
    refused = as_user("mes", "recipes", "program", "fine", "--for", "gcode", *place, "--version", "2", status=1)
    assert "NotApproved" in refused
    assert "AxesNotSpoken" in as_user("mes", "recipes", "program", "fine", "--for", "krl", *place, status=1)

    report = as_user("mes", "run", "plate", "--recipe", "fine", "--on", "ws1", "--mode", "production", "--follow")
    assert (report["state"], report["mode"]) == ("Completed", "production")
    assert as_user("visitor", "jobs", "show", report["job_id"])["samples"] == report["samples"]
    assert report["job_id"] in [job["job_id"] for job in as_user("visitor", "jobs", "list", "--on", "ws1")]
    assert as_user("visitor", "jobs", "show", learned["job_id"])["kind"] == "Learning"
    trace = tmp_path / "trace.csv"
    as_user("visitor", "jobs", "trace", report["job_id"], "-o", str(trace))
    rows = np.loadtxt(trace, delimiter=",", skiprows=1)
    assert rows.shape[1] == 7
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert "BadInvalidState" in as_user("mes", "jobs", "abort", report["job_id"], status=1)

    exported = tmp_path / "plate.json"
    as_user("engineer", "skills", "export", "plate", "--version", "1", "-o", str(exported))
    imported = as_user("teacher", "skills", "import", str(exported))
    assert imported == {"name": "plate", "version": 3}
    assert as_user("visitor", "skills", "show", "plate")["modelDigest"] == digest
    picture = tmp_path / "plate.png"
    as_user("visitor", "skills", "plot", "plate", "--version", "1", "-o", str(picture))
    assert picture.stat().st_size > 10_000

    as_user("engineer", "skills", "withdraw", "plate", "--on", "ws1")
    as_user("engineer", "skills", "retire", "plate", "--version", "1")
    as_user("engineer", "recipes", "delete", "fine")
    assert "BadNotExecutable" in as_user("mes", "run", "plate", "--on", "ws1", "--mode", "production", status=1)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("skills", "show", "none"), "SkillName"),
        (("recipes", "show", "none"), "RecipeId"),
        (("jobs", "show", "none"), "none"),
        (("run", "none", "--on", "ws1"), "SkillName"),
    ],
)
def test_what_is_not_there_is_named(as_user: Run, words: tuple[str, ...], says: str) -> None:
    assert says in as_user("mes", *words, status=1)


def test_a_wrong_password_is_one_sentence(as_user: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", "guessed wrong")
    assert "password" in as_user("admin", "skills", "list", status=1)


def test_a_client_that_is_not_trusted_is_told_what_to_do(
    as_user: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("OPCUA_SKILL_CLIENT_DIR", str(tmp_path / "stranger"))
    sentence = as_user("visitor", "skills", "list", status=1)
    assert "the server's log has the command" in " ".join(sentence.split())
    assert "stranger" in sentence
    assert "--data" not in sentence, "only the server knows its data folder: what can be run stands in its log"


def test_a_server_with_another_certificate_gets_no_password(as_user: Run, plant: "Plant") -> None:
    [known] = (plant.client_folder / "servers").glob("*.der")
    kept = known.read_bytes()
    try:
        known.write_bytes(b"another")
        assert "another certificate" in as_user("visitor", "skills", "list", status=1)
    finally:
        known.write_bytes(kept)


def test_tool_orientation_goes_from_files_into_the_skill_and_its_picture(
    as_user: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    people = simulated_people(3, 3, corners=ZIGZAG_IN_SPACE, orientation=True)[0]
    for one in people:
        write(tmp_path / f"{one.demonstration_id}.csv", one)
    files = [str(file) for file in sorted(tmp_path.glob("*.csv"))]
    assert "qx,qy,qz,qw" in Path(files[0]).read_text(encoding="utf-8").splitlines()[0]
    learned = as_user("teacher", "learn", "held", *files, "--type", "Gluing", "--option", "preset=free")
    assert learned["report"]["preset"] == "free"
    shown = as_user("visitor", "skills", "show", "held")
    assert {len(row) for row in shown["means"]} == {2 + 3 + 4}
    picture = tmp_path / "held.png"
    as_user("visitor", "skills", "plot", "held", "-o", str(picture))
    assert picture.stat().st_size > 10_000
    assert status_of(["skills", "show", "held", "--user", "visitor"]) == 0
    assert "the paper's preset, estimated" in capsys.readouterr().out

"""Exit status 0, 1, 2, and one sentence instead of a traceback."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from opcua_skill.commands.verbs import VERBS as VERBS_OF_THE_HELP_PAGE
from opcua_skill.commands.verbs import imported, status_of

VERBS = ("demo", "serve", "panel", "learn", "skills", "recipes", "run", "jobs", "users", "certificates", "bench")


@pytest.fixture(autouse=True)
def nobody_signed_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("OPCUA_SKILL_USER", "OPCUA_SKILL_PASSWORD", "OPCUA_SKILL_SERVER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("OPCUA_SKILL_CLIENT_DIR", str(tmp_path / "client"))


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_explains_itself(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of([verb, "--help"]) == 0
    assert verb in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["nonsense"],
        ["skills", "show"],
        ["skills", "deploy", "a"],
        ["run", "a", "--on", "ws1", "--mode", "fast"],
        ["learn", "a", "there-is-no-such-file.csv"],
        ["users", "add", "a", "--role", "boss"],
        ["skills", "approve", "a", "--digest", "not-hex", "--user", "a"],
    ],
)
def test_wrong_usage_is_two(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of(arguments) == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize("option", ["components=many", "speed=1", "preset"])
def test_a_wrong_learning_option_is_wrong_usage(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.csv"
    file.write_text("t,x,y\n0,0,0\n1,1,1\n")
    assert status_of(["learn", "a", str(file), "--option", option]) == 2
    assert option.partition("=")[0] in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["skills", "list"], "--user"),
        (["skills", "list", "--user", "me"], "OPCUA_SKILL_PASSWORD"),
        (["bench", "plant"], "benchmark"),
    ],
)
def test_what_cannot_be_done_is_one_with_one_sentence(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("opcua_skill.commands.bench.ROOT", tmp_path)
    assert status_of(arguments) == 1
    [line] = capsys.readouterr().err.strip().splitlines()
    assert line.startswith("error: ")
    assert says in line


def test_no_server_is_one_sentence_with_the_address(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", "irrelevant")
    assert status_of(["skills", "list", "--user", "me", "--server", "opc.tcp://127.0.0.1:9"]) == 1
    assert "opc.tcp://127.0.0.1:9" in capsys.readouterr().err


def test_a_recipe_file_says_which_field_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPCUA_SKILL_PASSWORD", "irrelevant")
    file = tmp_path / "fast.toml"
    file.write_text('recipe_id = "fast"\nskill_name = "a"\ntime_step = "quick"\n')
    assert status_of(["recipes", "put", str(file), "--user", "me"]) == 1
    error = capsys.readouterr().err
    assert "time_step" in error
    assert str(file) in error.replace("\n", "")


def test_users_live_in_the_data_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    data = ["--data", str(tmp_path / "data")]
    people = tmp_path / "people.csv"
    people.write_text("name,role,password\nada,engineer,correct horse\nbo,operator,battery staple\n")
    assert status_of(["users", "import", str(people), *data]) == 0
    assert status_of(["users", "import", str(people), *data]) == 1
    assert status_of(["users", "remove", "bo", *data]) == 0
    assert status_of(["users", "remove", "bo", *data]) == 1
    capsys.readouterr()
    assert status_of(["users", "list", "--json", *data]) == 0
    listed = json.loads(capsys.readouterr().out)
    assert [(user["name"], user["role"]) for user in listed] == [("ada", "engineer")]


def test_a_file_that_is_no_certificate_is_not_trusted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "client.der"
    file.write_text("nothing of the kind")
    assert status_of(["certificates", "trust", str(file), "--data", str(tmp_path / "data")]) == 1
    assert "not a certificate" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("name", VERBS_OF_THE_HELP_PAGE)
def test_the_help_page_says_of_a_verb_what_the_verb_says_of_itself(name: str) -> None:
    said = imported(name, VERBS_OF_THE_HELP_PAGE[name]).help
    assert said.splitlines()[0] == VERBS_OF_THE_HELP_PAGE[name].help


def test_the_help_page_imports_neither_the_protocol_nor_the_numbers() -> None:
    asked = "import sys; from opcua_skill.commands.verbs import status_of; status_of(['--help']); print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", asked], check=True, capture_output=True, text=True).stdout
    assert not {"asyncua", "numpy", "sqlalchemy", "pydantic"} & set(said.split())


def test_a_client_s_verb_imports_neither_the_server_s_parts_nor_the_database() -> None:
    asked = "import sys; import opcua_skill.commands.jobs; print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", asked], check=True, capture_output=True, text=True).stdout
    assert not {"scipy", "sqlalchemy", "opcua_skill.server", "sim", "matplotlib"} & set(said.split())

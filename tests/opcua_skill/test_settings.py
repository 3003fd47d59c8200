"""Configuration: a file, the environment over it, the caller over both; what is wrong is said by name."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from opcua_skill.configuration.settings import Settings


@pytest.fixture(autouse=True)
def clean_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)


def test_with_nothing_at_all_there_is_one_workstation_and_security_is_on() -> None:
    settings = Settings.load()
    assert [(one.name, one.arm, one.driver) for one in settings.workstations] == [("ws1", "panda", "pybullet")]
    assert settings.four_eyes
    assert not any(settings.security.model_dump().values())


def test_environment_wins_over_the_file_and_the_caller_over_both(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "plant.toml"
    file.write_text(
        'four_eyes = false\nendpoint = "opc.tcp://127.0.0.1:1"\n[limits]\nmax_queued_jobs = 3\nmax_page = 7\n'
    )
    monkeypatch.setenv("OPCUA_SKILL_LIMITS__MAX_QUEUED_JOBS", "9")
    settings = Settings.load(file, endpoint="opc.tcp://127.0.0.1:2")
    assert (settings.four_eyes, settings.endpoint) == (False, "opc.tcp://127.0.0.1:2")
    assert (settings.limits.max_queued_jobs, settings.limits.max_page) == (9, 7)


def test_workstations_come_from_the_file(tmp_path: Path) -> None:
    file = tmp_path / "plant.toml"
    file.write_text(
        '[[workstations]]\nname = "left"\narm = "xarm6"\nequipment = []\n[[workstations]]\nname = "right"\n'
    )
    settings = Settings.load(file)
    assert [one.name for one in settings.workstations] == ["left", "right"]
    assert settings.workstations[0].equipment == ()
    assert settings.workstations[1].equipment[0].atomic_skills == ("Dispense",)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("fore_eyes = true", "fore_eyes"),
        ("[limits]\nmax_page = 0", "max_page"),
        ('[[workstations]]\nname = "a/b"', "name"),
        ('[[workstations]]\nname = "ws1"\n[[workstations]]\nname = "ws1"', "workstations need names of their own"),
        ("workstations = []", "workstations"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, text: str, named: str) -> None:
    file = tmp_path / "plant.toml"
    file.write_text(text)
    with pytest.raises(ValidationError, match=named):
        Settings.load(file)

"""Servers of these tests are forked from a prepared process: what is started so is like what a person starts."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests import prepared

LIMIT = 60.0


def ended(tmp_path: Path, *words: str, **environment: str) -> tuple[int, str, str]:
    """Run a command in a forked process; return status, stdout and stderr."""
    errors = tmp_path / "errors"
    with errors.open("w") as stream:
        command = prepared.start(words, {**os.environ, **environment}, stream)
    with command.stdin, command.stdout:
        said = command.stdout.read()
    return command.wait(LIMIT), said, errors.read_text()


@pytest.mark.parametrize("words", [("--version",), ("serve", "--endpoint"), ("users", "list", "--data", "{empty}")])
def test_a_forked_command_says_and_returns_what_a_started_one_does(tmp_path: Path, words: tuple[str, ...]) -> None:
    words = tuple(word.format(empty=tmp_path / "empty") for word in words)
    command = [sys.executable, "-m", "opcua_skill.cli", *words]
    started = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, cwd=Path.cwd())
    assert ended(tmp_path, *words) == (started.returncode, started.stdout, started.stderr)


def test_a_forked_command_has_the_environment_it_was_given(tmp_path: Path) -> None:
    status, _, errors = ended(
        tmp_path, "serve", OPCUA_SKILL_ENDPOINT="opc.tcp://192.0.2.1:4840", OPCUA_SKILL_DATA=str(tmp_path)
    )
    assert status == 1
    assert "cannot serve at opc.tcp://192.0.2.1:4840" in errors


def test_a_killed_command_has_ended_by_that_signal(tmp_path: Path) -> None:
    (tmp_path / "plant.toml").write_text('[[workstations]]\nname = "ws1"\ndriver = "kinematic"\n')
    words = [
        "serve",
        "--config",
        str(tmp_path / "plant.toml"),
        "--data",
        str(tmp_path),
        "--endpoint",
        "opc.tcp://127.0.0.1:0",
    ]
    with (tmp_path / "errors").open("w") as stream:
        command = prepared.start([*words, "--until-stdin-closes"], os.environ, stream)
    with command.stdin, command.stdout:
        assert command.stdout.readline().startswith("listening on ")
        with pytest.raises(subprocess.TimeoutExpired):
            command.wait(0.0)
        command.kill()
        assert command.wait(LIMIT) == command.wait() == -signal.SIGKILL

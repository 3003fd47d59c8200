"""The demo: exit status, last line, pictures, and that nothing is left behind when it ends in any way."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from PIL import Image
from small_corner import small_corner

from library.readers import plain_csv

LIMIT = 600.0
NOT_PASSED_ON = ("PYTEST", "OPCUA_SKILL", "PYTHONDONTWRITEBYTECODE")
ROOT = Path(__file__).parents[2]
pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


def demo(folder: Path, *words: str) -> "subprocess.Popen[str]":
    """Start the demo in a process group and a temp folder of its own, so that whatever it leaves can be seen."""
    (folder / "tmp").mkdir()
    environment = {key: value for key, value in os.environ.items() if not key.startswith(NOT_PASSED_ON)}
    return subprocess.Popen(
        [sys.executable, "-m", "opcua_skill.cli", "demo", "--out", str(folder / "out"), *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**environment, "TMPDIR": str(folder / "tmp"), "HOME": str(folder), "TERM": "dumb"},
    )


def processes_on(folder: Path) -> list[str]:
    """Return the command lines of all processes that were given a path in the folder."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode()
                home = (entry / "environ").read_bytes().decode(errors="replace")
            except OSError:
                continue
            if words and f"TMPDIR={folder / 'tmp'}" in home:
                found.append(words)
    return found


def wait_until_nobody_is_left(folder: Path) -> None:
    deadline = time.monotonic() + 60.0
    while left := processes_on(folder):
        assert time.monotonic() < deadline, left
        time.sleep(0.1)


def test_the_demo_ends_well_with_its_line_and_its_pictures(tmp_path: Path) -> None:
    files = [tmp_path / f"{one.demonstration_id}.csv" for one in small_corner(4)]
    for file, one in zip(files, small_corner(4), strict=True):
        plain_csv.write(file, one)
    process = demo(tmp_path, *(word for file in files for word in ("--demonstrations", str(file))), "--json")
    out, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 0, errors
    result = json.loads(out.strip().splitlines()[-1])
    assert set(result) >= {"seconds_to_first_run", "path_error_mm", "runs", "pictures"}
    assert set(result["path_error_mm"]) == {"paper", "recommended"}
    first, second = result["runs"]
    assert first["samples"] != second["samples"]
    assert first["time_step_s"] != second["time_step_s"]
    assert max(first["tracking_rms_mm"], second["tracking_rms_mm"]) <= 0.1
    names = {Path(picture).name for picture in result["pictures"]}
    assert {"figure-3.png", "commanded-measured.png"} <= names
    for picture in result["pictures"]:
        with Image.open(picture) as image:
            assert min(image.size) > 300
    wait_until_nobody_is_left(tmp_path)
    assert not list((tmp_path / "tmp").glob("opcua-skill-demo-*")), "the demo's folder is left"


@pytest.mark.parametrize("signal_name", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_a_demo_that_is_stopped_leaves_no_process(signal_name: str, tmp_path: Path) -> None:
    process = demo(tmp_path, "--people", "simulated")
    deadline = time.monotonic() + LIMIT
    while not any("serve" in words for words in processes_on(tmp_path)):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.send_signal(getattr(signal, signal_name))
    _, errors = process.communicate(timeout=120.0)
    assert process.returncode != 0
    assert "Traceback" not in errors
    wait_until_nobody_is_left(tmp_path)


def test_an_arm_that_is_not_there_is_one_sentence(tmp_path: Path) -> None:
    process = demo(tmp_path, "--people", "simulated", "--arm", "octopus")
    _, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == 1
    assert "Traceback" not in errors
    assert "octopus" in errors
    wait_until_nobody_is_left(tmp_path)

"""Eclipse Milo, from Maven, does the main job: encrypted, signed in, with structures and events."""

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.conftest import Plant
from tests.interop.plan import holds, written

HERE = Path(__file__).parent / "milo"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def class_path() -> str:
    """Compile the client and return its class path."""
    file = HERE / "target" / "classpath"
    compiled = HERE / "target" / "classes" / "Story.class"
    source = HERE / "src" / "main" / "java" / "Story.java"
    if not (file.exists() and compiled.exists() and compiled.stat().st_mtime >= source.stat().st_mtime):
        command = ["mvn", "-q", "-B", "compile", "dependency:build-classpath", "-Dmdep.outputFile=target/classpath"]
        subprocess.run(command, cwd=HERE, check=True, timeout=280)
    return os.pathsep.join((str(HERE / "target" / "classes"), file.read_text().strip()))


@pytest.mark.timeout(500)
def test_milo_does_the_main_job(foreign_plant: Plant, class_path: str, tmp_path: Path):
    written(foreign_plant, tmp_path, "milo-edge")
    command = [
        "java",
        "-XX:TieredStopAtLevel=1",
        "-XX:+UseSerialGC",
        "-Xshare:auto",
        "-cp",
        class_path,
        "Story",
        str(tmp_path / "plan.properties"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr[-3000:]
    holds(json.loads(done.stdout.splitlines()[-1]))

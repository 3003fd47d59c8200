"""node-opcua, from npm, does the main job: encrypted, signed in, with structures and events."""

import json
import subprocess
from pathlib import Path

import pytest

from tests.conftest import Plant
from tests.interop.plan import holds, written

HERE = Path(__file__).parent / "node"
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def node_modules() -> None:
    """Install what the lock file names, once."""
    if not (HERE / "node_modules" / "node-opcua-client").exists():
        subprocess.run(["npm", "ci", "--ignore-scripts", "--silent"], cwd=HERE, check=True, timeout=170)


@pytest.mark.timeout(400)
def test_node_opcua_does_the_main_job(foreign_plant: Plant, node_modules: None, tmp_path: Path):
    plan = written(foreign_plant, tmp_path, "node-edge")
    done = subprocess.run(["node", "story.js", str(plan)], cwd=HERE, capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads(done.stdout.splitlines()[-1])
    holds(told)
    assert ["engineer", "UserName", "UA Binary", "opc.tcp"] in told["secured"]
    assert max(told["called"]) >= 3
    assert told["part"] == ["http://opcfoundation.org/UA/"]

"""A line of the learning benchmark's table, and the peers that it compares with, in an environment of their own."""

import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from models.demonstration import Demonstration, Floats

Row = dict[str, Any]
ENVIRONMENT = Path(__file__).resolve().parents[1] / ".tools" / "learning-peers"


class Peers:
    """The Python that has the peers, found or made once."""

    def __init__(self) -> None:
        self.why_not = ""
        self.python = Path(os.environ.get("OPCUA_SKILL_PEERS") or ENVIRONMENT / "bin" / "python")
        if not self.python.exists():
            self._make()

    def _make(self) -> None:
        needed = str(Path(__file__).resolve().parents[1] / "requirements-bench.txt")
        try:
            subprocess.run([sys.executable, "-m", "venv", str(ENVIRONMENT)], check=True, capture_output=True)
            command = [str(self.python), "-m", "pip", "install", "--quiet", "-r", needed]
            subprocess.run(command, check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            self.why_not = f"the peers' environment could not be made: {error}"

    def answers(self, tasks: list[tuple[str, Any]]) -> list[tuple[Any, float]]:
        """Return (result, processor seconds) of each task; a result that is text says what went wrong."""
        if self.why_not:
            return [(self.why_not, float("nan"))] * len(tasks)
        with tempfile.TemporaryDirectory() as folder:
            asked, answered = Path(folder) / "tasks.pickle", Path(folder) / "answers.pickle"
            asked.write_bytes(pickle.dumps(tasks))
            script = Path(__file__).with_name("learning_peers.py")
            environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONWARNINGS": "ignore"}
            command = [str(self.python), str(script), str(asked), str(answered)]
            subprocess.run(command, check=True, env=environment, capture_output=True)
            return pickle.loads(answered.read_bytes())


def row(
    name: str, ours: float, goal: str, holds: bool, peer: str = "", theirs: float | None = None, runs: int = 1
) -> Row:
    """Return one line of the table."""
    ratio = None if theirs is None or not ours else theirs / ours
    return {
        "name": f"learning: {name}",
        "ours": float(ours),
        "peer": peer,
        "theirs": theirs,
        "ratio": ratio,
        "goal": goal,
        "holds": bool(holds),
        "runs": runs,
    }


def plain(demonstrations: list[Demonstration]) -> list[tuple[Floats, Floats]]:
    """Return what the peers get: times and points."""
    return [(one.times - one.times[0], one.points) for one in demonstrations]

"""The peer of `bench execution` that is no dependency of the project, in an environment of its own.

As a script it runs in that environment and needs ``pin`` and numpy only: ``python execution_peers.py TASKS ANSWERS``,
two pickles. A task is ``(description, tip, home, rotation, points, repeats)``, an answer ``(joints, seconds)`` of the
quickest repeat, in processor time. Imported, it makes the environment at first use from
``requirements-bench-execution.txt`` (``OPCUA_SKILL_EXECUTION_PEERS`` names another Python that has them).
"""

# pyright: basic, reportMissingImports=false
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".tools" / "execution-peers"
REQUIREMENTS = ROOT / "requirements-bench-execution.txt"
PATIENCE = 900.0


def pinocchio_inverse(description, tip, home, rotation, points, repeats):
    """Damped Newton steps on Pinocchio's Jacobian to a nanometre, each point from the one before."""
    import pinocchio

    robot = pinocchio.buildModelFromXML(description)
    data, frame = robot.createData(), robot.getFrameId(tip)
    best, joints = float("inf"), []
    for _ in range(repeats):
        began = time.process_time()
        joints, q = [], np.array(home)
        for point in points:
            target = pinocchio.SE3(rotation, point)
            for _ in range(30):
                pinocchio.framesForwardKinematics(robot, data, q)
                error = pinocchio.log6(data.oMf[frame].actInv(target)).vector
                if np.abs(error).max() < 1e-9:
                    break
                jacobian = pinocchio.computeFrameJacobian(robot, data, q, frame)
                q = q + jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-10 * np.eye(6), error)
            joints.append(q)
        best = min(best, time.process_time() - began)
    return np.array(joints), best


def answers(tasks):
    """Return the answers to tasks, or the words of what went wrong."""
    try:
        python = _python()
    except (OSError, subprocess.SubprocessError) as error:
        reason = getattr(error, "stderr", "") or str(error)
        return f"its environment could not be made: {str(reason).strip().splitlines()[-1]}"
    with tempfile.TemporaryDirectory() as folder:
        asked, answered = Path(folder) / "tasks", Path(folder) / "answers"
        asked.write_bytes(pickle.dumps(tasks))
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": ""}
        command = [str(python), str(Path(__file__).resolve()), str(asked), str(answered)]
        try:
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        except OSError as error:
            return f"it could not be started: {error}"
        if done.returncode:
            return f"it failed: {(done.stderr.strip().splitlines() or ['no reason given'])[-1]}"
        return pickle.loads(answered.read_bytes())


def _python():
    """Return the Python that has the peers, made once, or raise why it cannot be made."""
    if given := os.environ.get("OPCUA_SKILL_EXECUTION_PEERS"):
        return Path(given)
    python, complete = ENVIRONMENT / "bin" / "python", ENVIRONMENT / "complete"
    wanted = REQUIREMENTS.read_text("utf-8")
    if complete.exists() and complete.read_text("utf-8") == wanted:
        return python
    beside = ROOT / ".tools" / "bin" / "uv"
    uv = shutil.which("uv") or (str(beside) if beside.exists() else "")
    if uv:
        make = [uv, "venv", "--quiet", "--clear", "--python", sys.executable, str(ENVIRONMENT)]
        fill = [uv, "pip", "install", "--quiet", "--python", str(python), "-r", str(REQUIREMENTS)]
    else:
        make = [sys.executable, "-m", "venv", "--clear", str(ENVIRONMENT)]
        fill = [str(python), "-m", "pip", "install", "--quiet", "-r", str(REQUIREMENTS)]
    for command in (make, fill):
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=PATIENCE)
    complete.write_text(wanted, "utf-8")
    return python


def main():
    """Answer every task."""
    asked, answered = (Path(name) for name in sys.argv[1:3])
    answered.write_bytes(pickle.dumps([pinocchio_inverse(*task) for task in pickle.loads(asked.read_bytes())]))


if __name__ == "__main__":
    main()

"""Pictures of a plan: a still of the arm, the operator's card, a short animation. Drawn in a worker process."""

import asyncio
import os
import pickle
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Literal

from models.errors import SkillError
from sim.arm_model import ArmModel
from sim.plan import MotionPlan

PATIENCE = 180.0


class PictureFailed(SkillError):
    """A picture that could not be drawn; the message is one sentence."""


async def still(model: ArmModel, plan: MotionPlan, view: Literal["arm", "work"] = "arm") -> bytes:
    """Return a PNG of the arm in the middle of its path: the whole arm, or the nozzle at work."""
    return await _drawn("still", model, plan, view)


async def operator_card(model: ArmModel, plan: MotionPlan) -> bytes:
    """Return a PNG to approve a run by: the arm, the nozzle, and the path to scale with speed and valve."""
    return await _drawn("card", model, plan)


async def animation(model: ArmModel, plan: MotionPlan, frames: int = 48) -> bytes:
    """Return a WebP of the whole run, from home to home, about five seconds long."""
    return await _drawn("animation", model, plan, frames)


async def _drawn(drawing: str, *arguments: object) -> bytes:
    """Return what a worker drew. Raises ``PictureFailed`` if it could not."""
    return await asyncio.to_thread(_draw, drawing, arguments)


def _draw(drawing: str, arguments: tuple[object, ...]) -> bytes:
    with tempfile.TemporaryDirectory() as place:
        request, result = Path(place) / "request", Path(place) / "result"
        request.write_bytes(pickle.dumps((drawing, arguments)))
        command = [sys.executable, "-m", "sim.rendering.worker", str(request), str(result)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                command, stdin=subprocess.DEVNULL, capture_output=True, timeout=PATIENCE, env=environment, check=False
            )
        except subprocess.TimeoutExpired:
            raise PictureFailed(f"the picture took longer than {PATIENCE:.0f} s") from None
        if done.returncode != 0 or not result.exists():
            last = done.stderr.decode(errors="replace").strip().splitlines()[-1:] or ["no reason given"]
            raise PictureFailed(f"the picture could not be drawn: {last[0]}")
        return result.read_bytes()

"""One workstation as a client sees it: run skills there, follow them, read what the arm does."""

from dataclasses import dataclass

import numpy as np

from models.demonstration import Floats
from opcua_skill.client.checking import RunCheck, ask_check
from opcua_skill.client.errors import WrongArgument
from opcua_skill.client.recorder import Recorder
from opcua_skill.client.session import Session
from opcua_skill.wire import to_server
from opcua_skill.wire.values import (
    MODES,
    ArmLinks,
    JobReport,
    JobTrace,
    JointTrace,
    Mode,
    QueueStatus,
    Recipe,
    Started,
)


@dataclass(frozen=True, slots=True, eq=False)
class DeployedModel:
    """The model of a deployed skill, as its nodes show it: ``means`` (K, D), ``covariances`` (K, D, D)."""

    version: int
    model_digest: bytes
    means: Floats
    covariances: Floats


@dataclass(frozen=True, slots=True, eq=False)
class ArmReading:
    """What the arm's nodes show: ``position`` of the joints in rad, ``tool_pose`` x y z qx qy qz qw in m.

    ``fault`` is empty when nothing is wrong; ``speed_override`` is a fraction of the planned speed.
    """

    position: Floats
    tool_pose: Floats
    speed_override: float
    at_rest: bool
    mode: str
    fault: str


@dataclass(frozen=True, slots=True)
class LockReading:
    """Who has the arm for themselves: empty ``user`` and ``client`` while nobody has; ``seconds`` it still lasts."""

    locked: bool
    user: str
    client: str
    seconds: float


async def ask_report(session: Session, place: str, job_id: str) -> JobReport:
    """Return a job's report from the library or a workstation."""
    [value] = await session.call(place, "GetJob", JobId=to_server.string(job_id))
    return to_server.job_in(value)


class Workstation:
    """The methods and nodes under ``Machines/<name>``."""

    def __init__(self, session: Session, name: str) -> None:
        self.session = session
        self.name = name
        self.path = f"Machines/{name}"
        self.recorder = Recorder(session, f"{self.path}/Recorder")

    async def execute(self, skill_name: str, *, recipe_id: str = "", mode: Mode = "simulation") -> Started:
        """Queue a run. All is checked first; motion never runs inside the call. No recipe: the skill's own.

        Nothing moves unless ``mode`` says so: *test* (slowly) and *production* move the arm.
        """
        if mode not in MODES:
            raise WrongArgument.none_of("mode", mode, MODES)
        job_id, state = await self.session.call(
            self.path,
            "ExecuteSkill",
            SkillName=to_server.string(skill_name),
            RecipeId=to_server.string(recipe_id),
            Mode=to_server.int32(MODES.index(mode)),
        )
        return Started(job_id, state)

    async def check(self, recipe: Recipe, version: int = 0) -> RunCheck:
        """Have a run planned and checked without queueing it; ``version`` 0 is the one that a simulation would run."""
        return await ask_check(self.session, self.path, recipe, version)

    async def pause(self, job_id: str, comment: str = "") -> str:
        """Pause a job; return its state."""
        return await self._steer("PauseJob", job_id, comment)

    async def resume(self, job_id: str, comment: str = "") -> str:
        """Resume a paused job; return its state."""
        return await self._steer("ResumeJob", job_id, comment)

    async def abort(self, job_id: str, comment: str = "") -> str:
        """Abort a job; return its state: `Stopping` until the arm is at rest."""
        return await self._steer("AbortJob", job_id, comment)

    async def _steer(self, method: str, job_id: str, comment: str) -> str:
        [state] = await self.session.call(
            self.path, method, JobId=to_server.string(job_id), Comment=to_server.string(comment)
        )
        return state

    async def job(self, job_id: str) -> JobReport:
        """Return a job's report."""
        return await ask_report(self.session, self.path, job_id)

    async def jobs(self, state: str = "", limit: int = 100) -> list[JobReport]:
        """Return the newest jobs, of one state if given."""
        [values] = await self.session.call(
            self.path, "ListJobs", State=to_server.string(state), Limit=to_server.uint32(limit)
        )
        return [to_server.job_in(value) for value in values or ()]

    async def trace(self, job_id: str) -> JobTrace:
        """Return what was commanded and measured during a job."""
        times, commanded, measured = await self.session.call(self.path, "GetTrace", JobId=to_server.string(job_id))
        return JobTrace(
            np.asarray(times or [], dtype=np.float64),
            to_server.matrix(commanded, len(times or [])),
            to_server.matrix(measured, len(times or [])),
        )

    async def joint_trace(self, job_id: str) -> JointTrace:
        """Return the joints that were commanded and measured during a job."""
        times, commanded, measured = await self.session.call(self.path, "GetJointTrace", JobId=to_server.string(job_id))
        rows = len(times or [])
        return JointTrace(np.asarray(times or []), to_server.matrix(commanded, rows), to_server.matrix(measured, rows))

    async def links(self) -> ArmLinks:
        """Return the arm's links: what is needed to draw it."""
        names = ("LinkNames", "LinkOrigins", "LinkAxes", "LinkCapsules")
        links, origins, axes, capsules = await self.session.read(*(f"{self.path}/Equipment/Arm/{one}" for one in names))
        shaped = (np.asarray(flat).reshape(-1, width) for flat, width in ((origins, 7), (axes, 3), (capsules, 8)))
        return ArmLinks(tuple(links), *shaped)

    async def model(self, skill_name: str) -> DeployedModel:
        """Return version, digest, means and covariances of a skill deployed here, read from its nodes."""
        at = f"{self.path}/Skills/{skill_name}"
        names = ("Version", "ModelDigest", "Means", "Covariances")
        version, digest, means, covariances = await self.session.read(*(f"{at}/{name}" for name in names))
        flat = np.asarray(means, dtype=np.float64)
        deviations = np.asarray(covariances, dtype=np.float64)
        columns = round(deviations.size / flat.size)
        return DeployedModel(
            int(version),
            bytes.fromhex(digest) if isinstance(digest, str) else bytes(digest),
            flat.reshape(-1, columns),
            deviations.reshape(-1, columns, columns),
        )

    async def arm(self) -> ArmReading:
        """Return what the arm's nodes show now."""
        names = ("Position", "ToolPose", "SpeedOverride", "AtRest", "Mode", "Fault")
        position, pose, override, at_rest, mode, fault = await self.session.read(
            *(f"{self.path}/Arm/{name}" for name in names)
        )
        return ArmReading(np.asarray(position), np.asarray(pose), float(override), bool(at_rest), mode, fault or "")

    async def queue(self) -> QueueStatus:
        """Return whether the next job here may begin, and if not, why."""
        names = ("State", "HeldBecause", "HeldBy", "HeldSince", "Waiting")
        state, because, by, since, waiting = await self.session.read(*(f"{self.path}/Queue/{name}" for name in names))
        return QueueStatus(state, because or "", by or "", to_server.moment(since), int(waiting))

    async def release_queue(self, comment: str = "") -> str:
        """Let the next job begin; refused while the arm does not stand ready at home. Return the queue's state."""
        [state] = await self.session.call(f"{self.path}/Queue", "ReleaseQueue", Comment=to_server.string(comment))
        return state

    async def hold_queue(self, comment: str = "") -> str:
        """Let no further job begin until the queue is released; what runs goes on. Return the queue's state."""
        [state] = await self.session.call(f"{self.path}/Queue", "HoldQueue", Comment=to_server.string(comment))
        return state

    async def protective_stop(self, comment: str = "") -> None:
        """Stop the arm as fast as its limits allow; it refuses to move until `reset`. Not an emergency stop."""
        await self.session.call(f"{self.path}/Arm", "ProtectiveStop", Comment=to_server.string(comment))

    async def reset(self, comment: str = "") -> None:
        """Acknowledge a protective stop or a fault."""
        await self.session.call(f"{self.path}/Arm", "Reset", Comment=to_server.string(comment))

    async def go_home(self, comment: str = "") -> None:
        """Move the arm slowly to where every run starts, after a stop on the path; returns when it begins to move."""
        await self.session.call(f"{self.path}/Arm", "GoHome", Comment=to_server.string(comment))

    async def stop_motion(self, comment: str = "") -> None:
        """Bring whatever moves the arm to rest on its path and hold the queue; no reset is needed afterwards."""
        await self.session.call(f"{self.path}/Arm", "StopMotion", Comment=to_server.string(comment))

    async def set_speed_override(self, fraction: float) -> None:
        """Slow the arm down, or let it go faster again: a fraction of the planned speed, above 0, up to 1."""
        await self.session.write(f"{self.path}/Arm/SpeedOverride", to_server.double(fraction))

    async def lock(self, context: str = "") -> bool:
        """Take the arm for this session, until `unlock` or its end; return whether it is ours now."""
        [status] = await self.session.call(f"{self.path}/Arm/Lock", "InitLock", Context=to_server.string(context))
        return status == 0

    async def lock_state(self) -> LockReading:
        """Return who has the arm."""
        names = ("Locked", "LockingUser", "LockingClient", "RemainingLockTime")
        locked, user, client, left = await self.session.read(*(f"{self.path}/Arm/Lock/{name}" for name in names))
        return LockReading(bool(locked), user or "", client or "", float(left or 0.0) / 1000.0)

    async def renew_lock(self) -> bool:
        """Keep the arm for longer; return whether it is still ours."""
        [status] = await self.session.call(f"{self.path}/Arm/Lock", "RenewLock")
        return status == 0

    async def break_lock(self) -> bool:
        """Take the lock away from whoever has it (engineers and above); return whether somebody had it."""
        [status] = await self.session.call(f"{self.path}/Arm/Lock", "BreakLock")
        return status == 0

    async def unlock(self) -> bool:
        """Give the arm back; return whether it was ours."""
        [status] = await self.session.call(f"{self.path}/Arm/Lock", "ExitLock")
        return status == 0

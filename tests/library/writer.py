"""Processes that store versions one after another and say so after each: run, and killed, by test_survival."""

import asyncio
import importlib.util
import os
import sys
from pathlib import Path

from library.lifecycle import JobState
from library.records import AuditEntry, JobReport
from library.store import SkillLibrary
from models.demonstration import Edits
from models.options import LearningOptions

spec = importlib.util.spec_from_file_location("values", Path(__file__).with_name("conftest.py"))
assert spec is not None
assert spec.loader is not None
values = importlib.util.module_from_spec(spec)
spec.loader.exec_module(values)


def say(*words: object) -> None:
    """Say a line in one piece: several processes speak into one pipe, and Python may be told not to buffer."""
    os.write(sys.stdout.fileno(), (" ".join(map(str, words)) + "\n").encode())


async def write(path: str, name: str, count: int) -> None:
    async with await SkillLibrary.open(path) as library:
        for number in range(count):
            job_id = f"{name}-{os.getpid()}-{number}"
            await library.add_job(JobReport(job_id=job_id, kind="Learning", skill_name=name))
            await library.move_job(job_id, JobState.RUNNING)
            recordings = [values.make_demonstration(f"d{one}", samples=400, shift=number * 1e-4) for one in range(4)]
            stored = await library.add_version(
                name=name,
                semantic_type="urn:example:Gluing",
                required_atomic_skills=("FollowPath",),
                recordings=recordings,
                edits=Edits(),
                options=LearningOptions(),
                learned=values.make_learned(recordings, values.make_motion(number)),
                actor="tina",
                job_id=job_id,
            )
            say("version", name, stored.version, stored.model_digest, job_id)
            entry_id = await library.audit(AuditEntry(actor="tina", action=name))
            say("audit", name, entry_id)


def serve() -> None:
    """Do as told, line by line: fork a writer (in milliseconds, where a start takes seconds) or await one."""
    for line in sys.stdin:
        order, *arguments = line.rstrip("\n").split("\t")
        if order == "wait":
            _, status = os.waitpid(int(arguments[0]), 0)
            say("gone", arguments[0], os.waitstatus_to_exitcode(status))
            continue
        path, name, count = arguments
        if os.fork() == 0:
            say("pid", os.getpid())
            asyncio.run(write(path, name, int(count)))
            os._exit(0)


if __name__ == "__main__":
    serve()

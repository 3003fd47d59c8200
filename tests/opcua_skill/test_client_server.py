"""The typed client against a real server: everything INTERFACE offers, from demonstrations to a trace."""

import numpy as np

from models.people import simulated_people
from opcua_skill.client import SkillClient

PEOPLE, _ = simulated_people(6)


async def test_from_demonstrations_to_a_trace(teacher: SkillClient, engineer: SkillClient, mes: SkillClient) -> None:
    report = await teacher.learn_to_the_end("plate", PEOPLE, semantic_type="Gluing")
    assert report.state == "Completed", report
    skill = await engineer.skill("plate")
    assert await engineer.approve("plate", skill.version, skill.model_digest, "good") == "Approved"
    await engineer.deploy("plate", skill.version, "ws1")
    started = await mes.workstation("ws1").execute("plate")
    job = await mes.follow(started.job_id, on="ws1")
    assert job.state == "Completed", job
    trace = await mes.workstation("ws1").trace(started.job_id)
    assert trace.commanded.shape == (len(trace.times), 3)
    assert np.isfinite(trace.measured).all()

"""The typed client against a real server: everything INTERFACE offers, from demonstrations to a trace."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from asyncua import Node, ua

from models.people import simulated_people
from opcua_skill.client import ClientError, SkillClient, structures
from tests.conftest import Plant

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


async def test_signing_in_takes_few_requests(teacher: SkillClient) -> None:
    """Whoever signs in waits for each of them: walking through the server's types would take five hundred."""
    protocol = teacher.session._client.uaclient.protocol
    assert protocol is not None
    assert protocol._request_id < 25


async def test_the_client_asks_for_every_data_type_of_ours(teacher: SkillClient) -> None:
    client, ours = teacher.session._client, set[str]()

    async def walk(node: Node) -> None:
        for below in await node.get_children_descriptions(refs=ua.ObjectIds.HasSubtype):
            if below.NodeId.NamespaceIndex == teacher.session._types:
                ours.add(below.BrowseName.Name)
                await walk(client.get_node(below.NodeId))

    for base in (client.nodes.base_structure_type, client.nodes.enum_data_type):
        await walk(base)
    assert ours == set(structures.NAMES)
    assert all(getattr(ua, name).data_type.NamespaceIndex == teacher.session._types for name in ours)


async def test_a_private_key_that_is_none_is_one_sentence(plant: Plant, tmp_path: Path) -> None:
    shutil.copytree(plant.client_folder, tmp_path / "client")
    (tmp_path / "client" / "client.pem").write_text("this is no key")
    with pytest.raises(ClientError, match="private key is not an RSA key"):
        async with SkillClient(plant.url, "teacher", plant.password, folder=tmp_path / "client"):
            pass

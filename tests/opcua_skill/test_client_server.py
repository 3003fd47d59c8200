"""The typed client against a real server: everything INTERFACE offers, from demonstrations to a trace."""

import re
import shutil
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from asyncua import Node, ua

from models.synthetic import simulated_people
from opcua_skill.client import ClientError, Failure, Refused, SkillClient, WrongArgument
from opcua_skill.wire import structures, to_server
from tests.conftest import Plant

PEOPLE, _ = simulated_people(6)


async def test_from_demonstrations_to_a_trace(teacher: SkillClient, engineer: SkillClient, mes: SkillClient) -> None:
    report = await teacher.learn_to_the_end("plate", PEOPLE, semantic_type="Gluing")
    assert report.state == "Completed", report
    skill = await engineer.skill("plate")
    assert await engineer.approve("plate", skill.version, skill.model_digest, "good") == "Approved"
    await engineer.deploy("plate", skill.version, "ws1")
    started = await mes.workstation("ws1").execute("plate", mode="production")
    job = await mes.follow(started.job_id, on="ws1")
    assert (job.state, job.mode, job.failure) == ("Completed", "production", Failure.NONE), job
    assert not job.failure
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
    with pytest.raises(ClientError, match="is no private key"):
        async with SkillClient(plant.url, "teacher", plant.password, folder=tmp_path / "client"):
            pass


async def test_without_a_mode_nothing_moves(mes: SkillClient) -> None:
    workstation = mes.workstation("ws1")
    before = (await workstation.arm()).position
    job = await mes.follow((await workstation.execute("plate")).job_id, on="ws1")
    assert (job.state, job.mode) == ("Completed", "simulation")
    assert ((await workstation.arm()).position == before).all()


async def test_what_no_server_could_take_names_argument_and_choices(mes: SkillClient) -> None:
    workstation = mes.workstation("ws1")
    with pytest.raises(WrongArgument, match="mode is 'fast': it has to be one of simulation, test, production") as mode:
        await workstation.execute("plate", mode="fast")  # type: ignore[arg-type]
    assert (mode.value.argument, mode.value.choices) == ("mode", ("simulation", "test", "production"))
    with pytest.raises(WrongArgument, match="SkillName is 7: it has to be a String"):
        await workstation.execute(7)  # type: ignore[arg-type]
    with pytest.raises(WrongArgument, match="Limit is -1: it has to be a UInt32"):
        await workstation.jobs(limit=-1)
    with pytest.raises(WrongArgument, match="SpeedOverride is 'slow': it has to be a Double"):
        await workstation.set_speed_override("slow")  # type: ignore[arg-type]
    assert (await workstation.jobs(limit=1))[0].skill_name == "plate", "the connection is as good as before"


async def test_a_workstation_that_there_is_not_is_told_with_those_there_are(mes: SkillClient) -> None:
    typo = mes.workstation("ws11")
    for ask in (typo.arm, typo.jobs, lambda: typo.execute("plate"), lambda: typo.set_speed_override(0.5)):
        with pytest.raises(Refused, match="there is no workstation ws11 on this server: it has ws1") as refused:
            await ask()
        assert (refused.value.status, refused.value.argument) == ("BadNotFound", "Workstation")
    with pytest.raises(Refused, match="no workstation ws11"):
        await mes.follow("run-1", on="ws11")
    with pytest.raises(Refused, match="BadNotFound"):  # an unknown job is still an unknown job
        await mes.session.call("Machines/ws1", "GetJob", JobId=to_server.string("run-none"))


async def test_the_example_of_the_events_runs_as_it_stands(plant: Plant, capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[2] / "docs/how-to/connect-another-client.md").read_text(encoding="utf-8")
    found = re.search(r"<!-- runs in tests/opcua_skill/test_client_server.py -->\n```python\n(.*?)```", page, re.S)
    assert found is not None
    code = found[1].replace("opc.tcp://127.0.0.1:4840", plant.url).replace('"zigzag"', '"plate"')
    code = code.replace("password)", f"password, folder=Path({str(plant.client_folder)!r}))")
    names = {"password": plant.password, "Path": Path}
    await eval(compile(code, "events", "exec", flags=0x2000), names)
    assert "ws1" in capsys.readouterr().out


def test_the_packages_say_that_they_are_typed() -> None:
    assert all((files(name) / "py.typed").is_file() for name in ("opcua_skill", "models", "library", "sim"))

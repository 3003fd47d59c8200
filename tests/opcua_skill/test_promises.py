"""What the server promises to whom: rights told as they are, locks that end with their session, health told truly."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
import pytest_asyncio
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from library.store import SkillLibrary
from opcua_skill.configuration.settings import Security, Settings, Workstation
from opcua_skill.security import TrustList, ensure_client_certificate, hash_password
from opcua_skill.security.access import Role
from opcua_skill.server.app import SkillServerApp
from opcua_skill.server.health import Health
from sim.drivers.kinematic.arm import KinematicArm
from sim.robots import load

pytestmark = pytest.mark.asyncio(loop_scope="module")
PASSWORD, URI = "correct horse battery", "urn:opcua-skill:test"
FIRST_ROLE = {
    "observer": """
        SkillLibrary: FindSkills GetSkill GetDemonstrations GetTrajectory ExportSkill GetJob
        Machines/ws1: GetJob ListJobs GetTrace GetJointTrace
        Machines/ws1/Recorder: GetRecording ListDemonstrations GetDemonstration""",
    "operator": """
        SkillLibrary: GetRecipe ListRecipes
        Machines/ws1: ExecuteSkill CheckRun PauseJob ResumeJob AbortJob
        Machines/ws1/Queue: HoldQueue ReleaseQueue
        Machines/ws1/Arm: ProtectiveStop StopMotion Reset GoHome
        Machines/ws1/Arm/Lock: InitLock RenewLock ExitLock""",
    "teacher": """
        SkillLibrary: LearnFromDemonstration RemovePoints LearnAgain ImportSkill
        Machines/ws1/Recorder: StartRecording AppendSamples FinishRecording DiscardRecording LearnFromRecording""",
    "engineer": """
        SkillLibrary: Approve Reject Deploy Withdraw Retire PutRecipe DeleteRecipe GetAuditTrail
        Machines/ws1/Arm/Lock: BreakLock""",
    "admin": """
        SkillLibrary: ListSessions EndSession""",
}
"""Section 7 of docs/interface.md: the first role that may call each method; those after it may too."""


def first_roles() -> dict[str, Role]:
    return {
        f"{where.strip()}/{name}": Role(role)
        for role, lines in FIRST_ROLE.items()
        for where, names in (line.split(":") for line in lines.strip().splitlines())
        for name in names.split()
    }


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def app(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[SkillServerApp]:
    data = tmp_path_factory.mktemp("plant")
    settings = Settings(data=data, endpoint="opc.tcp://127.0.0.1:0", workstations=(Workstation(driver="kinematic"),))
    secret = hash_password(PASSWORD)
    async with await SkillLibrary.open(settings.database_address) as library:
        for role in Role:
            await library.add_user(role.value, role.value, secret)
    own = ensure_client_certificate(data / "client", URI)
    TrustList(data / "certificates").trust(own.certificate_file)
    async with SkillServerApp(settings, lambda *_: KinematicArm(load("panda"), realtime=False)) as running:
        yield running


@asynccontextmanager
async def signed_in(app: SkillServerApp, role: str, lives: int = 60_000) -> AsyncIterator[Client]:
    own, client = ensure_client_certificate(app.settings.data / "client", URI), Client(app.endpoint, timeout=30)
    client.application_uri, client.session_timeout = URI, lives
    if role:
        client.set_user(role)
        client.set_password(PASSWORD)
    await client.set_security(SecurityPolicyBasic256Sha256, str(own.certificate_file), str(own.key_file))
    async with client:
        yield client


async def at(client: Client, path: str) -> ua.NodeId:
    return ua.NodeId(path, await client.get_namespace_index("urn:opcua-skill:instances"))


async def until_it_reads(client: Client, path: str, wanted: object) -> None:
    node = client.get_node(await at(client, path))
    async with asyncio.timeout(20):
        while await node.read_value() != wanted:
            await asyncio.sleep(0.02)


async def test_each_role_is_told_truly_which_methods_it_may_call(app: SkillServerApp):
    expected = first_roles()
    methods = app.server.iserver.method_service._methods
    offered = {node.Identifier for node in methods if node.NamespaceIndex}  # the standard's are for everybody
    assert offered == expected.keys(), "a method is not in the table of rights, or not offered"
    for role in Role:
        async with signed_in(app, role.value) as client:
            nodes = [client.get_node(await at(client, path)) for path in expected]
            told = await client.read_attributes(nodes, ua.AttributeIds.UserExecutable)
        may = {path for path, value in zip(expected, told, strict=True) if value.Value.Value}
        assert may == {path for path, first in expected.items() if role in first.and_above}, role


async def test_a_lock_on_the_arm_ends_with_its_session(app: SkillServerApp):
    async with signed_in(app, "engineer") as watching, signed_in(app, "operator", lives=1_000) as owner:
        lock = await at(owner, "Machines/ws1/Arm/Lock")
        init = await at(owner, "Machines/ws1/Arm/Lock/InitLock")
        assert await owner.get_node(lock).call_method(init, "setting up") == 0
        await until_it_reads(watching, "Machines/ws1/Arm/Lock/Locked", True)
        await until_it_reads(watching, "Machines/ws1/Arm/Lock/LockingUser", "operator")
        owner.uaclient.protocol.transport.abort()  # the owner does not say goodbye
        await until_it_reads(watching, "Machines/ws1/Arm/Lock/Locked", False)


async def test_what_a_variable_is_told_to_do_is_in_the_audit_trail(app: SkillServerApp):
    async with signed_in(app, "operator") as client:
        override = client.get_node(await at(client, "Machines/ws1/Arm/SpeedOverride"))
        await override.write_value(0.5)
        with pytest.raises(ua.uaerrors.BadOutOfRange):
            await override.write_value(7.0)
        await override.write_value(1.0)
    trail = [one for one in await app.library.audit_trail(limit=10) if one.action == "Write"]
    assert [(one.actor, one.status, one.arguments["Value"]) for one in reversed(trail)] == [
        ("operator", "Good", 0.5),
        ("operator", "BadOutOfRange", 7.0),
        ("operator", "Good", 1.0),
    ]


async def test_service_level_falls_while_the_audit_trail_cannot_be_written_and_rises_again(
    app: SkillServerApp, monkeypatch: pytest.MonkeyPatch
):
    async def full(_: object) -> int:
        raise OSError("the disk is full")

    async with signed_in(app, "operator") as client:
        level = client.get_node(ua.NodeId(ua.ObjectIds.Server_ServiceLevel))
        assert await level.read_value() == 255
        with monkeypatch.context() as trouble:
            trouble.setattr(app.library, "audit", full)
            override = client.get_node(await at(client, "Machines/ws1/Arm/SpeedOverride"))
            await override.write_value(1.0)
            async with asyncio.timeout(20):
                while await level.read_value() >= 200:
                    await asyncio.sleep(0.02)
        await override.write_value(1.0)
        async with asyncio.timeout(20):
            while await level.read_value() != 255:
                await asyncio.sleep(0.02)


class Silent:
    """A library that does not answer until it is told to."""

    def __init__(self) -> None:
        self.answers = asyncio.Event()

    async def audit_trail(self, limit: int = 0) -> list:
        await self.answers.wait()
        return []


async def test_a_library_that_does_not_answer_is_a_fault_until_it_does():
    library = Silent()
    health = Health(library, check_every=0.01, limit=0.05)  # type: ignore[arg-type]
    health.start()
    async with asyncio.timeout(20):
        while health.faults != ("the library does not answer",):
            await asyncio.sleep(0.01)
        library.answers.set()
        while health.faults:
            await asyncio.sleep(0.01)
    await health.stop()


async def test_a_server_that_protects_less_says_so_to_every_client(app: SkillServerApp, tmp_path_factory):
    async with signed_in(app, "observer") as client:
        assert not await client.get_node(await at(client, "SkillLibrary/Insecure")).read_value()
    data = tmp_path_factory.mktemp("weak")
    weak = Settings(
        data=data,
        endpoint="opc.tcp://127.0.0.1:0",
        workstations=(Workstation(driver="kinematic"),),
        security=Security(allow_anonymous=True),
    )
    own = ensure_client_certificate(data / "client", URI)
    TrustList(data / "certificates").trust(own.certificate_file)
    async with (
        SkillServerApp(weak, lambda *_: KinematicArm(load("panda"), realtime=False)) as running,
        signed_in(running, "") as client,
    ):
        told = await client.get_node(await at(client, "SkillLibrary/Insecure")).read_value()
    assert told == list(running.insecure) == ["anonymous sessions are accepted, as observers"]


async def test_who_is_connected_is_told_that_the_server_stops(app: SkillServerApp):
    async with signed_in(app, "observer") as client:
        status = client.get_node(ua.NodeId(ua.ObjectIds.Server_ServerStatus))
        running = await status.read_value()
        assert (running.State, running.SecondsTillShutdown) == (ua.ServerState.Running, 0)
        await app.server._tell_shutdown()
        stopping = await status.read_value()
        assert (stopping.State, stopping.ShutdownReason.Text) == (ua.ServerState.Shutdown, "the server is stopped")
        state = client.get_node(ua.NodeId(ua.ObjectIds.Server_ServerStatus_State))
        assert await state.read_value() == ua.ServerState.Shutdown

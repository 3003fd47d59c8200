"""Job management as a manufacturing system finds it: by the standards' namespaces, and no name of ours but ws1's."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import pytest
import pytest_asyncio
from asyncua import Client, Node, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from small_corner import small_corner

from opcua_skill.client import Refused

if TYPE_CHECKING:
    from tests.conftest import Plant

MACHINERY = "http://opcfoundation.org/UA/Machinery/"
JOBS = "http://opcfoundation.org/UA/Machinery/Jobs/"
ISA95 = "http://opcfoundation.org/UA/ISA95-JOBCONTROL_V2/"
LIMIT = 60.0
DONE, UNKNOWN, INVALID_STATUS = 1, 1 << 1, 1 << 3
OTHER_CONTENT = 1 << 4 | 1 << 36
pytestmark = pytest.mark.asyncio(loop_scope="module")


@pytest.fixture(scope="module")
def plant(make_plant: Callable[..., "Plant"]) -> "Plant":
    """A plant with the face of jobs, and an arm that takes its time."""
    return make_plant(
        'faces = ["jobs", "machinery"]\n[[workstations]]\nname = "ws1"\ndriver = "kinematic"\nrealtime = true\n'
    )


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def deployed(plant: "Plant") -> None:
    """Have a skill learned, approved and deployed, as people have done before any order comes."""
    async with plant.sign_in("teacher") as teacher, plant.sign_in("engineer") as engineer:
        await teacher.learn_to_the_end("glue", small_corner(5), semantic_type="Gluing")
        description = await engineer.skill("glue", 1)
        await engineer.approve("glue", 1, description.model_digest)
        await engineer.deploy("glue", 1, "ws1")


@dataclass
class Mes:
    """A manufacturing system that knows OPC 40001-3 and OPC 10031-4, and nothing else."""

    client: Client
    index: dict[str, int]
    control: Node
    results: Node
    events: list[tuple[Any, ...]] = field(default_factory=list)

    async def call(self, method: str, *arguments: Any, of: Node | None = None) -> list[Any]:
        owner = of or self.control
        node = await owner.get_child(f"{self.index[ISA95]}:{method}")
        [result] = await self.client.uaclient.session.call(
            [ua.CallMethodRequest(owner.nodeid, node.nodeid, list(arguments))]
        )
        result.StatusCode.check()
        return [variant.Value for variant in result.OutputArguments]

    async def order(self, method: str, order: Any) -> int:
        [status] = await self.call(method, ua.Variant(order, ua.VariantType.ExtensionObject), no_comment())
        return status

    async def steer(self, method: str, order_id: str) -> int:
        [status] = await self.call(method, ua.Variant(order_id, ua.VariantType.String), no_comment())
        return status

    async def listed(self) -> dict[str, list[str]]:
        node = await self.control.get_child(f"{self.index[ISA95]}:JobOrderList")
        return {one.JobOrder.JobOrderID: [s.StateText.Text for s in one.State] for one in await node.read_value()}

    async def response(self, order_id: str) -> tuple[Any, int]:
        asked = ua.Variant(order_id, ua.VariantType.String)
        response, status = await self.call("RequestJobResponseByJobOrderID", asked, of=self.results)
        return response, status

    async def until(self, order_id: str, *states: str) -> None:
        """Wait until an event has told that an order is in a state."""
        async with asyncio.timeout(LIMIT):
            while (order_id, states) not in self.events:
                await asyncio.sleep(0.02)

    def event_notification(self, event: Any) -> None:
        self.events.append((event.JobOrder.JobOrderID, tuple(state.StateText.Text for state in event.JobState)))


def no_comment() -> ua.Variant:
    return ua.Variant([], ua.VariantType.LocalizedText, is_array=True)


def an_order(order_id: str, master: str = "glue@1", **said: ua.Variant) -> Any:
    kinds: Any = ua
    parameters = [kinds.ISA95ParameterDataType(ID=name, Value=value) for name, value in said.items()]
    return kinds.ISA95JobOrderDataType(
        JobOrderID=order_id,
        WorkMasterID=[kinds.ISA95WorkMasterDataType(ID=master)],
        JobOrderParameters=parameters or None,
    )


def nothing(kind: Any) -> Any:
    """Return a structure of which every field that may be null is null."""
    return kind(**{one.name: None for one in fields(kind) if one.name not in {"Encoding", "Value"}})


def with_parameter(order_id: str, parameter: Any) -> Any:
    order = an_order(order_id)
    order.JobOrderParameters = [parameter]
    return order


@asynccontextmanager
async def signed_in(plant: "Plant") -> AsyncIterator[Mes]:
    client = Client(plant.url, timeout=30, watchdog_intervall=15.0)
    client.application_uri = "urn:opcua-skill:client"
    certificate, key = plant.client_folder / "client.der", plant.client_folder / "client.pem"
    mode = ua.MessageSecurityMode.SignAndEncrypt
    await client.set_security(SecurityPolicyBasic256Sha256, str(certificate), str(key), mode=mode)
    client.set_user("mes")
    client.set_password(plant.password)
    async with client:
        await client.load_data_type_definitions()
        index = {uri: await client.get_namespace_index(uri) for uri in (MACHINERY, JOBS, ISA95)}
        machinery, jobs = index[MACHINERY], index[JOBS]
        machines = await client.nodes.objects.get_child(f"{machinery}:Machines")
        [machine] = [one for one in await machines.get_children() if (await one.read_browse_name()).Name == "ws1"]
        management = await machine.get_child([f"{machinery}:MachineryBuildingBlocks", f"{jobs}:JobManagement"])
        assert await management.read_type_definition() == ua.NodeId(1003, jobs)
        control, results = [
            await management.get_child(f"{jobs}:{one}") for one in ("JobOrderControl", "JobOrderResults")
        ]
        mes = Mes(client, index, control, results)
        subscription = await client.create_subscription(50, mes)
        await subscription.subscribe_events(control, ua.NodeId(1006, index[ISA95]))
        yield mes
        await subscription.delete()


async def test_work_masters_are_the_deployed_versions_with_units_and_ranges(plant: "Plant", deployed: None) -> None:
    async with signed_in(plant) as mes:
        [master] = await (await mes.control.get_child(f"{mes.index[ISA95]}:WorkMaster")).read_value()
        assert master.ID == "glue@1"
        said = {one.ID: one for one in master.Parameters}
        assert said["JobExecutionMode"].Value.Value == 2 and said["RecipeId"].Value.Value
        assert said["Duration"].EngineeringUnits.DisplayName.Text == "s"
        assert {one.ID: one.Value.Value for one in said["SpeedOverride"].Subparameters} == {"Min": 0.0, "Max": 1.0}


async def test_an_order_is_stored_started_followed_paused_resumed_and_answered(plant: "Plant", deployed: None) -> None:
    async with signed_in(plant) as mes:
        order = an_order("PO/4711 a", SpeedOverride=ua.Variant(0.5, ua.VariantType.Double))
        assert await mes.order("Store", order) == DONE
        assert (await mes.listed())["PO/4711 a"] == ["NotAllowedToStart", "Ready"]
        assert await mes.steer("Pause", "PO/4711 a") == INVALID_STATUS
        assert await mes.steer("Start", "PO/4711 a") == DONE
        await mes.until("PO/4711 a", "Running")
        assert await mes.steer("Pause", "PO/4711 a") == DONE
        await mes.until("PO/4711 a", "Interrupted", "Suspended")
        assert (await mes.listed())["PO/4711 a"] == ["Interrupted", "Suspended"]
        assert await mes.steer("Resume", "PO/4711 a") == DONE
        await mes.until("PO/4711 a", "Ended", "Completed")
        response, status = await mes.response("PO/4711 a")
        figures = {one.ID: one.Value.Value for one in response.JobResponseData}
        assert status == DONE and figures["JobResult"] == 1 and figures["ActualProductionTime"] > 0.0
        assert figures["PathErrorMaximum"] > 0.0 and response.StartTime < response.EndTime
        ended = ua.Variant([response.JobState[0]], ua.VariantType.ExtensionObject, is_array=True)
        responses, status = await mes.call("RequestJobResponseByJobOrderState", ended, of=mes.results)
        assert "PO/4711 a" in {one.JobOrderID for one in responses} and status == DONE
        async with plant.sign_in("mes") as ours:
            report = await ours.workstation("ws1").job(figures["JobId"])
            assert report.state == "Completed", "our own face shows another state"
        assert await mes.order("StoreAndStart", order) == DONE, "the same order again is an answer"
        assert (await mes.response("PO/4711 a"))[0].JobResponseID == response.JobResponseID, "it was run again"
        assert await mes.order("StoreAndStart", an_order("PO/4711 a")) == OTHER_CONTENT
        assert await mes.steer("Clear", "PO/4711 a") == DONE
        assert (await mes.response("PO/4711 a"))[1] == UNKNOWN
        states = [state for name, state in mes.events if name == "PO/4711 a"]
        assert states[0] == ("NotAllowedToStart", "Ready") and ("Running",) in states


async def test_what_nobody_could_obey_is_refused_and_not_stored(plant: "Plant", deployed: None) -> None:
    double = ua.VariantType.Double
    kinds: Any = ua
    unknown = 1 << 4 | 1 << 37
    async with signed_in(plant) as mes:
        for order, bits in (
            (an_order("r1", "nothing@1"), unknown),
            (an_order("r0", "glue@99999999999999999999"), unknown),
            (an_order("r2", Colour=ua.Variant("red")), 1 << 32),
            (an_order("r3", SpeedOverride=ua.Variant(7.0, double)), 1 << 32),
            (an_order("r4", RunsPlanned=ua.Variant(3, ua.VariantType.UInt32)), 1 << 32),
            (an_order("r5", RecipeId=ua.Variant("none")), unknown),
            (an_order(""), 1 << 32),
            (kinds.ISA95JobOrderDataType(), 1 << 32),
            (kinds.ISA95JobOrderDataType(JobOrderID="r6"), 1 << 32),
            (
                kinds.ISA95JobOrderDataType(JobOrderID="r7", WorkMasterID=[nothing(kinds.ISA95WorkMasterDataType)]),
                unknown,
            ),
            (with_parameter("r8", nothing(kinds.ISA95ParameterDataType)), 1 << 32),
            (with_parameter("r9", kinds.ISA95ParameterDataType(ID="SpeedOverride", Value=ua.Variant())), 1 << 32),
        ):
            assert await mes.order("StoreAndStart", order) == bits, order
        assert not {"r0", "r1", "r2", "r3", "r4", "r5", "r6", "r7", "r8", "r9", ""} & set(await mes.listed())


async def test_orders_and_the_held_queue_outlive_a_kill(plant: "Plant", deployed: None) -> None:
    async with signed_in(plant) as mes:
        assert await mes.order("StoreAndStart", an_order("k-run")) == DONE
        await mes.until("k-run", "Running")
        assert await mes.order("StoreAndStart", an_order("k-wait")) == DONE
        assert await mes.steer("Stop", "k-wait") == INVALID_STATUS, "what has not begun is not stopped"
        assert await mes.steer("RevokeStart", "k-wait") == DONE
        assert (await mes.listed())["k-wait"] == ["NotAllowedToStart", "Ready"]
        assert await mes.order("Update", an_order("k-wait", TimeStep=ua.Variant(0.01, ua.VariantType.Double))) == DONE
        await asyncio.to_thread(plant.kill)
    await asyncio.to_thread(plant.start)
    async with signed_in(plant) as mes:
        listed = await mes.listed()
        assert listed["k-run"] == ["Aborted"] and listed["k-wait"] == ["NotAllowedToStart", "Ready"]
        assert await mes.steer("Start", "k-wait") == DONE
        assert (await mes.listed())["k-wait"] == ["AllowedToStart", "Waiting"], "the queue is held after a kill"
        assert await mes.steer("Cancel", "k-wait") == DONE and "k-wait" not in await mes.listed()
        async with plant.sign_in("mes") as ours:
            await ours.workstation("ws1").release_queue("nothing lies on the table")
        assert await mes.order("StoreAndStart", an_order("s1")) == DONE
        await mes.until("s1", "Running")
        assert await mes.steer("Stop", "s1") == DONE
        await mes.until("s1", "Ended", "Completed")
        figures = {one.ID: one.Value.Value for one in (await mes.response("s1"))[0].JobResponseData}
        assert figures["JobResult"] == 2, "a run that was stopped was no success"
        assert await mes.order("Store", an_order("a1")) == DONE
        assert await mes.steer("Abort", "a1") == DONE and (await mes.listed())["a1"] == ["Aborted"]


async def test_the_execution_mode_is_honoured(plant: "Plant", deployed: None) -> None:
    def in_mode(order_id: str, mode: int) -> Any:
        return an_order(order_id, "glue", JobExecutionMode=ua.Variant(mode, ua.VariantType.Int32))

    async with signed_in(plant) as mes:
        async with plant.sign_in("mes") as ours:
            await ours.workstation("ws1").hold_queue("the arm is being cleaned")
        assert await mes.order("StoreAndStart", in_mode("m0", 0)) == DONE
        await mes.until("m0", "Ended", "Completed")
        with pytest.raises(ua.UaStatusCodeError) as refused:
            await mes.order("StoreAndStart", in_mode("m1", 1))
        assert refused.value.code == ua.StatusCodes.BadUserAccessDenied, "test mode is an engineer's"
        assert await mes.order("StoreAndStart", in_mode("m2", 2)) == DONE
        listed = await mes.listed()
        assert listed["m2"] == ["AllowedToStart", "Waiting"] and "m1" not in listed
        assert await mes.steer("Abort", "m2") == DONE
        await mes.until("m2", "Aborted")


@dataclass
class States:
    """What the two state machines of a machine have told of: the transitions, by the state machine's name."""

    told: list[tuple[str, str, str]] = field(default_factory=list)

    def event_notification(self, event: Any) -> None:
        self.told.append((event.SourceName, event.FromState.Text, event.ToState.Text))

    async def until(self, *transition: str) -> None:
        async with asyncio.timeout(LIMIT):
            while transition not in self.told:
                await asyncio.sleep(0.02)


async def test_the_machine_tells_its_state_and_operation_mode(plant: "Plant", deployed: None) -> None:
    async with signed_in(plant) as mes, plant.sign_in("mes") as ours:
        machinery = mes.index[MACHINERY]
        machines = await mes.client.nodes.objects.get_child(f"{machinery}:Machines")
        [machine] = [one for one in await machines.get_children() if (await one.read_browse_name()).Name == "ws1"]
        blocks = await machine.get_child(f"{machinery}:MachineryBuildingBlocks")
        state = await blocks.get_child(f"{machinery}:MachineryItemState")
        mode = await blocks.get_child(f"{machinery}:MachineryOperationMode")
        assert await state.read_type_definition() == ua.NodeId(1002, machinery)
        assert await mode.read_type_definition() == ua.NodeId(1008, machinery)
        states = States()
        subscription = await mes.client.create_subscription(50, states)
        await subscription.subscribe_events(machine, ua.ObjectIds.TransitionEventType)
        ws1 = ours.workstation("ws1")
        if (await (await mode.get_child("0:CurrentState")).read_value()).Text == "Setup":
            try:
                await ws1.release_queue("nothing lies on the table")
            except Refused:
                await ws1.go_home()
                await states.until("MachineryItemState", "Executing", "NotExecuting")
                await ws1.release_queue("nothing lies on the table")
            await states.until("MachineryOperationMode", "Setup", "Processing")
        states.told.clear()
        assert await mes.order("StoreAndStart", an_order("state-1")) == DONE
        await states.until("MachineryItemState", "NotExecuting", "Executing")
        assert (await (await mode.get_child("0:CurrentState")).read_value()).Text == "Processing"
        assert await mes.steer("Pause", "state-1") == DONE
        await states.until("MachineryItemState", "Executing", "NotExecuting")
        current = await state.get_child("0:CurrentState")
        assert (await current.read_value()).Text == "NotExecuting"
        told = await (await current.get_child("0:Id")).read_value()
        assert (await mes.client.get_node(told).read_browse_name()).Name == "NotExecuting"
        assert await (await current.get_child("0:Number")).read_value() == 2
        last = await state.get_child("0:LastTransition")
        assert (await last.read_value()).Text == "FromExecutingToNotExecuting"
        assert await (await last.get_child("0:Number")).read_value() == 8
        assert await mes.steer("Abort", "state-1") == DONE
        await states.until("MachineryOperationMode", "Processing", "Setup")
        await ws1.protective_stop("a hand is in the cell")
        await states.until("MachineryItemState", "NotExecuting", "OutOfService")
        await states.until("MachineryOperationMode", "Setup", "None")
        await subscription.delete()

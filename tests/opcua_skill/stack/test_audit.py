"""Who comes to the door is recorded and told: sign-ins, refused sign-ins, refused certificates."""

import base64
from pathlib import Path

import pytest
from asyncua import ua

from opcua_skill.security import TrustList
from opcua_skill.stack.address_space.values import node_id
from opcua_skill.stack.diagnostics.audit import SignInRecord, WriteRecord, sign_in_event
from opcua_skill.stack.services.calls import Refused
from tests.opcua_skill.stack.small_server import Bench
from tests.opcua_skill.stack.test_events import listen

pytestmark = pytest.mark.asyncio(loop_scope="package")


async def test_a_sign_in_is_recorded_and_then_told(bench: Bench):
    records: list[SignInRecord] = []

    async def note(record: SignInRecord) -> None:
        records.append(record)

    bench.server.iserver.on_sign_in = note
    async with bench.client("engineer") as client:
        heard = await listen(client, client.nodes.server, ua.ObjectIds.AuditActivateSessionEventType)
        async with bench.client("operator"):
            event = await heard.next()
            assert (event.ClientUserId, event.Status, event.StatusCodeId.name) == ("operator", True, "Good")
            assert (records[-1].user, records[-1].role, records[-1].good) == ("operator", "operator", True)
            assert event.SessionId.to_string() == records[-1].session_id
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            async with bench.client("observer", "not the password"):
                pass
        event = await heard.next()
        assert (event.ClientUserId, event.Status, event.StatusCodeId.name) == ("observer", False, "BadUserAccessDenied")
        assert "not the password" not in str(event)
        assert (records[-1].user, records[-1].role, records[-1].status_name) == ("observer", "", "BadUserAccessDenied")
    bench.server.iserver.on_sign_in = None


async def test_a_refused_certificate_is_told_with_the_certificate(bench: Bench, tmp_path: Path):
    async with bench.client("engineer") as client:
        heard = await listen(client, client.nodes.server, ua.ObjectIds.AuditCertificateUntrustedEventType)
        with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
            async with bench.client("engineer", certificate=tmp_path / "stranger"):
                pass
        event = await heard.next()
        assert event.Certificate == (tmp_path / "stranger" / "client.der").read_bytes()
    rejected = [one for one in TrustList(bench.server.security.folder).listed() if not one.trusted]
    assert len(rejected) == 1


async def test_a_session_whose_id_looks_like_a_number_signs_in_like_any_other():
    identifier = base64.b64decode("0xVk9Jeuk9LkdC8z6ywePg==")
    told = SignInRecord("eve", "engineer", "password", "127.0.0.1", node_id(identifier, 1).to_string(), 0)
    assert sign_in_event(told, "urn:test").SessionId == node_id(identifier, 1)


async def test_audit_events_are_for_engineers_and_for_whom_they_are_about(bench: Bench):
    who = f"{bench.index}:WhoAmI"
    async with bench.client("observer") as observer, bench.client("engineer") as engineer:
        ears = [
            await listen(one, one.nodes.server, ua.ObjectIds.AuditUpdateMethodEventType) for one in (observer, engineer)
        ]
        async with bench.client("operator") as operator:
            await operator.get_node(bench.cell).call_method(who)
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await observer.get_node(bench.cell).call_method(f"{bench.index}:Engineer")
        assert [(await ears[1].next()).ClientUserId for _ in range(2)] == ["operator", "observer"]
        assert (await ears[0].next()).ClientUserId == "observer"


async def test_a_write_that_commands_is_recorded_and_then_told_done_or_refused(bench: Bench):
    node, records = ua.NodeId("Cell/Locked", bench.index), []

    async def obey(value: float) -> None:
        if value > 9.0:
            raise Refused(ua.StatusCodes.BadOutOfRange, "too far")

    async def keep(record: WriteRecord) -> None:
        records.append(record)

    await bench.server.get_node(node).write_value(2.5)
    bench.server.obey_writes(node, obey)
    bench.server.iserver.on_written = keep
    try:
        async with bench.client("engineer") as engineer, bench.client("operator") as operator:
            heard = await listen(engineer, engineer.nodes.server, ua.ObjectIds.AuditWriteUpdateEventType)
            await engineer.get_node(node).write_value(3.5)
            for client, value in ((engineer, 10.0), (operator, 1.0)):
                with pytest.raises(ua.UaError):
                    await client.get_node(node).write_value(value)
            told = [await heard.next() for _ in range(3)]
    finally:
        del bench.server.iserver.on_write[node]
        bench.server.iserver.on_written = None
        await bench.server.get_node(node).write_value(2.5)
    assert [(event.ClientUserId, event.NewValue, event.Status) for event in told] == [
        ("engineer", 3.5, True),
        ("engineer", 10.0, False),
        ("operator", 1.0, False),
    ]
    assert (told[0].OldValue, told[0].SourceNode, told[0].AttributeId) == (2.5, node, 13)
    assert [(one.caller.name, one.new.Value, one.status_name) for one in records] == [
        ("engineer", 3.5, "Good"),
        ("engineer", 10.0, "BadOutOfRange"),
        ("operator", 1.0, "BadUserAccessDenied"),
    ]
    assert "too far" in told[1].Message.Text


async def test_an_audit_event_names_the_client_s_own_id_of_the_request(bench: Bench):
    async with bench.client("engineer") as client:
        heard = await listen(client, client.nodes.server, ua.ObjectIds.AuditUpdateMethodEventType)
        request = ua.CallRequest()
        request.RequestHeader.AuditEntryId = "order 66"
        method = ua.NodeId("Cell/WhoAmI", bench.index)
        request.Parameters.MethodsToCall = [ua.CallMethodRequest(ObjectId=bench.cell, MethodId=method)]
        await client.uaclient.protocol.send_request(request)
        await client.get_node(bench.cell).call_method(f"{bench.index}:WhoAmI")
        assert [(await heard.next()).ClientAuditEntryId or "" for _ in range(2)] == ["order 66", ""]
    assert [record.client_audit_entry_id for record in bench.records] == ["order 66", ""]

"""How asyncua by itself lets clients in and serves their connections.

A test that fails here says which of ours may go; `replacements.py` names it.
"""

import asyncio

import pytest
from asyncua import Server, ua
from asyncua.common.connection import MessageChunk, SecureConnection, TransportLimits
from asyncua.common.utils import Buffer
from asyncua.crypto.permission_rules import UserRole
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256, SecurityPolicyNone
from asyncua.server.binary_server_asyncio import OPCUAProtocol
from asyncua.server.uaprocessor import PublishRequestData
from asyncua.ua.ua_binary import struct_to_binary

from opcua_skill.stack.limits import Limits
from tests.opcua_skill.stack.small_server import keys, until
from tests.opcua_skill.stack.stock_server import SEQUENCE, Stock, Wire, call, client, mended, processor, still_raises

pytestmark = pytest.mark.asyncio(loop_scope="package")
Codes, Ids, VALUE = ua.StatusCodes, ua.ObjectIds, ua.AttributeIds.Value
HOUR = 3_600_000.0


async def test_any_password_is_good(stock: Stock):
    manager = stock.iserver.user_manager
    user = manager.get_user(stock.iserver, username="admin", password="anything")
    assert user.role == UserRole.Admin, mended("passwords are checked", "internal.py: _NobodyByDefault")


async def test_session_tokens_count_up(stock: Stock):
    one, other = stock.session(), stock.session()
    step = other.auth_token.Identifier - one.auth_token.Identifier
    assert step == 1, mended("session tokens are random", "sessions.py: Session.__init__")
    await one.close_session()
    await other.close_session()


async def test_the_certificate_that_is_named_is_the_one_that_is_checked(stock: Stock, monkeypatch):
    checked = []

    async def validate(certificate, description) -> None:
        checked.append(certificate)

    monkeypatch.setattr(stock.iserver, "certificate_validator", validate)
    session, params = stock.session(), ua.CreateSessionParameters()
    params.ClientCertificate = next((keys() / "client").rglob("*.der")).read_bytes()
    await session.create_session(params)
    await session.close_session()
    assert len(checked) == 1, mended("a certificate the channel does not have is refused", "internal.py: admit_client")


async def test_a_connection_may_have_many_sessions(stock: Stock):
    async with client(stock) as one:
        before = len(stock.iserver._external_sessions)
        await one.create_session()
        after = len(stock.iserver._external_sessions)
        await one.activate_session()
    assert after == before + 1, mended("a connection has one session", "session_services.py: _create_session")


async def test_a_session_is_attached_before_its_user_is_proven(stock: Stock):
    session, (other, _) = stock.session(), processor(stock)
    await session.create_session(ua.CreateSessionParameters())
    request = ua.ActivateSessionRequest()
    request.RequestHeader.AuthenticationToken = session.auth_token
    request.Parameters.UserIdentityToken = ua.IssuedIdentityToken()
    await other.process_message(SEQUENCE, Buffer(struct_to_binary(request)))
    assert not session.is_activated()
    assert other.session is session, mended("first proven, then attached", "session_services.py: _activate_session")
    await other.close()


async def test_a_request_is_not_asked_for_its_token(stock: Stock):
    async with client(stock) as one:
        session = one.uaclient.session
        own, session.authentication_token = session.authentication_token, ua.NodeId(b"another", 0)
        try:
            told = await one.get_node(stock.node("Word")).read_value()
        finally:
            session.authentication_token = own
    assert told == "weld", mended("a request needs its session's token", "processor.py: Processor._session_of")


async def test_a_password_is_encrypted_by_the_channel_alone():
    server = Server()
    server._set_endpoints(SecurityPolicyBasic256Sha256, ua.MessageSecurityMode.SignAndEncrypt, 1)
    (told,) = [
        token.SecurityPolicyUri
        for token in server.iserver.endpoints[0].UserIdentityTokens
        if token.TokenType == ua.UserTokenType.UserName
    ]
    assert told == SecurityPolicyNone.URI, mended("passwords are encrypted twice", "server.py: _set_endpoints")


async def test_port_zero_is_told_as_zero(stock: Stock):
    told = stock.iserver.endpoints[0].EndpointUrl
    assert ":0/" in told, mended("the port that was taken is told", "server.py: SkillServer._tell_real_port")


async def test_a_discovery_server_that_is_away_is_an_error(stock: Stock):
    with still_raises(OSError, "a discovery server that is away is tried again", "discovery.py: Registration"):
        await Server().register_to_discovery("opc.tcp://127.0.0.1:1", period=60)


def connection(stock: Stock, others: list) -> tuple[OPCUAProtocol, Wire]:
    wire = Wire()
    made = OPCUAProtocol(stock.iserver, [], others, [], TransportLimits())
    made.connection_made(wire)
    return made, wire


async def gone(made: OPCUAProtocol) -> None:
    made.connection_lost(None)
    await asyncio.gather(*made.closing_tasks)


async def test_the_first_to_come_keeps_others_out(stock: Stock, monkeypatch):
    monkeypatch.setattr(stock.iserver, "max_connections", 1)
    others: list = []
    first, first_wire = connection(stock, others)
    _, second_wire = connection(stock, others)
    assert (first_wire.closed, second_wire.closed) == (False, True), mended(
        "a silent connection makes room", "transport.py: Connection.connection_made"
    )
    await gone(first)


async def test_a_chunk_is_awaited_whatever_size_it_announces(stock: Stock):
    made, wire = connection(stock, [])
    made.data_received(b"MSGF" + (2**31 - 1).to_bytes(4, "little") + bytes(100))
    assert not wire.closed, mended("sizes are looked at", "transport.py: Connection.data_received")
    await gone(made)


async def test_a_lost_connection_is_kept_for_a_while(stock: Stock):
    made, _ = connection(stock, [])
    await gone(made)
    assert made.closing_tasks, mended("what is closed is forgotten", "transport.py: Connection.connection_lost")


async def test_a_closed_connection_keeps_what_waited(stock: Stock):
    one, _ = processor(stock)
    one._publish_requests.append(PublishRequestData(ua.RequestHeader(), SEQUENCE, []))
    await one.close()
    assert one._publish_requests, mended("publish requests go with their connection", "processor.py: Processor.close")


async def test_a_message_may_be_as_large_before_sign_in_as_after(stock: Stock):
    one, _ = processor(stock)
    largest = Limits().largest_message_before_sign_in
    assert one._limits.is_msg_size_within_limit(largest + 1) and not hasattr(SecureConnection, "receive"), mended(
        "there is a limit before sign-in", "chunks.py: SecureChannel.receive, processor.py: Processor.take"
    )


async def test_an_answer_may_be_larger_than_the_client_takes(stock: Stock):
    one, wire = processor(stock)
    hello = ua.Hello(ReceiveBufferSize=8192, SendBufferSize=8192, MaxMessageSize=8192, MaxChunkCount=1)
    one._limits.create_acknowledge_and_set_limits(hello)
    response = ua.ReadResponse()
    response.Results = [ua.DataValue(ua.Variant(bytes(100_000)))]
    one.send_response(1, SEQUENCE, response)
    assert len(wire.written) > 100_000, mended("the client's limit holds", "processor.py: Processor.send_response")


async def test_a_chunk_is_several_objects(monkeypatch):
    made, stock_chunks = [], MessageChunk.message_to_chunks
    monkeypatch.setattr(MessageChunk, "message_to_chunks", lambda *a, **k: made.append(1) or stock_chunks(*a, **k))
    SecureConnection(SecurityPolicyNone(), TransportLimits()).message_to_binary(b"x")
    assert made, mended("chunks are made as bytes", "chunks.py: SecureChannel.message_to_binary")


async def test_a_call_that_takes_long_holds_up_the_next(stock: Stock):
    stock.released.clear()
    stock.waiting.clear()
    async with client(stock) as one:
        slow = asyncio.create_task(one.uaclient.call([call(stock, "Wait")]))
        await stock.waiting.wait()
        fast = asyncio.create_task(one.uaclient.call([call(stock, "First", 1.0)]))
        await asyncio.sleep(0.1)  # nothing is waited for: the answer must not come
        held_up = not fast.done()
        stock.released.set()
        await asyncio.gather(slow, fast)
    assert held_up, mended("long calls go on beside", "transport.py: Connection._process_received_message_loop")


async def test_a_call_ends_with_its_connection(stock: Stock):
    stock.released.clear()
    stock.waiting.clear()
    stock.ended.clear()
    one = client(stock)
    await one.connect()
    lost = asyncio.create_task(one.uaclient.call([call(stock, "Wait")]))
    await stock.waiting.wait()
    one.uaclient.protocol.transport.abort()
    await until(lambda: bool(stock.ended))
    assert stock.ended == ["cancelled"], mended("a call runs to its end", "calls.py: CheckedMethods._call and drain")
    lost.cancel()
    await asyncio.gather(lost, one.disconnect(), return_exceptions=True)


async def test_stopping_waits_for_the_clock_s_next_tick():
    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:0/stopping")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
    await server.start()
    clock = server.iserver.time_task
    await server.stop()
    assert not clock.cancelled(), mended("stopping ends the clock", "internal.py: SkillInternalServer.stop")

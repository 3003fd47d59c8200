"""What somebody who has signed in may try: kept in bounds, while others are served."""

import asyncio
import math
import struct

import pytest
from asyncua import Client, ua
from asyncua.ua.ua_binary import struct_to_binary

from tests.faults.hostile.peer import insider, raw_request
from tests.faults.hostile.scene import Scene
from tests.faults.hostile.witness import client_of
from tests.opcua_skill.stack.small_server import until

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.slow]

Ids, Codes = ua.ObjectIds, ua.StatusCodes
CALL, READ, BROWSE = (
    Ids.CallRequest_Encoding_DefaultBinary,
    Ids.ReadRequest_Encoding_DefaultBinary,
    Ids.BrowseRequest_Encoding_DefaultBinary,
)


def a_call(scene: Scene, variant: bytes) -> bytes:
    """Return the parameters of a call of Length with one argument as encoded by hand."""
    request = ua.CallMethodRequest()
    request.ObjectId, request.MethodId = ua.NodeId("Cell", scene.index), ua.NodeId("Cell/Length", scene.index)
    start = struct_to_binary(request)[:-4]
    return struct.pack("<i", 1) + start + struct.pack("<i", 1) + variant


VARIANTS = {
    "null array of 2^31-1": struct.pack("<Bi", 0x80, 2**31 - 1),
    "double array of 2^31-1": struct.pack("<Bi", 0x80 | 11, 2**31 - 1),
    "2 million variants": struct.pack("<Bi", 0x80 | 24, 2_000_000) + b"\x01\x01" * 2_000_000,
    "999 x 1001 from 4 values": struct.pack("<Bi4di2i", 0xC0 | 11, 4, 1, 2, 3, 4, 2, 999, 1001),
    "negative dimensions": struct.pack("<Bi4di2i", 0xC0 | 11, 4, 1, 2, 3, 4, 2, -1, -4),
    "variants nested 20000 deep": (b"\x98" + struct.pack("<i", 1)) * 20_000,
    "text that is not UTF-8": struct.pack("<Bi", 12, 3) + b"\xff\xfe\xfd",
    "structure nobody knows": struct.pack("<BBBHBi", 22, 1, 5, 999, 1, 4) + b"abcd",
    "string of 2^31-1": struct.pack("<Bi", 12, 2**31 - 1),
    "type nobody knows": struct.pack("<B", 0x3F),
}


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
async def test_an_argument_that_is_not_what_it_claims_is_refused_at_once(scene: Scene, variant: bytes):
    async with scene.attack(), insider(scene) as client:
        await raw_request(client, CALL, a_call(scene, variant))
    async with insider(scene) as client:
        assert await client.nodes.server_state.read_value() == 0


def many_calls(count: int) -> bytes:
    request = ua.CallMethodRequest(ObjectId=ua.NodeId(Ids.Server), MethodId=ua.NodeId(Ids.Server_GetMonitoredItems))
    return struct.pack("<i", count) + struct_to_binary(request) * count


def many_reads(count: int) -> bytes:
    item = ua.ReadValueId(NodeId=ua.NodeId(Ids.Server_NamespaceArray), AttributeId=ua.AttributeIds.Value)
    return struct.pack("<dIi", 0.0, 2, count) + struct_to_binary(item) * count


def many_browses(count: int) -> bytes:
    wanted = ua.BrowseDescription(NodeId=ua.NodeId(Ids.BaseObjectType), IncludeSubtypes=True, ResultMask=63)
    wanted.ReferenceTypeId = ua.NodeId(Ids.HierarchicalReferences)
    return struct_to_binary(ua.ViewDescription()) + struct.pack("<Ii", 0, count) + struct_to_binary(wanted) * count


def long_path(count: int) -> bytes:
    element = ua.RelativePathElement(IncludeSubtypes=True, TargetName=ua.QualifiedName("Types"))
    path = ua.ua_binary.nodeid_to_binary(ua.NodeId(Ids.RootFolder))
    return struct.pack("<i", 1) + path + struct.pack("<i", count) + struct_to_binary(element) * count


TRANSLATE = Ids.TranslateBrowsePathsToNodeIdsRequest_Encoding_DefaultBinary
HEAPS = {
    "20000 calls": (CALL, many_calls(20_000)),
    "100000 reads": (READ, many_reads(100_000)),
    "3000 browses": (BROWSE, many_browses(3_000)),
    "path of 50000 elements": (TRANSLATE, long_path(50_000)),
    "path of 60 elements": (TRANSLATE, long_path(60)),
    "as many reads as allowed": (READ, many_reads(1_000)),
    "as many browses as allowed": (BROWSE, many_browses(250)),
}


@pytest.mark.parametrize(("kind", "body"), HEAPS.values(), ids=HEAPS)
async def test_a_heap_of_operations_does_not_hold_others_up(scene: Scene, kind: int, body: bytes):
    async with scene.attack(), insider(scene) as client:
        for _ in range(3):
            await raw_request(client, kind, body)


async def test_a_message_larger_than_the_limit_is_cut_off(scene: Scene):
    async with scene.attack(), insider(scene) as client:
        assert await raw_request(client, CALL, b"\0" * 17 * 1024 * 1024) == -1


async def test_a_client_that_drops_the_connection_in_the_middle_of_a_call_leaves_nothing(scene: Scene):
    async with scene.attack():
        for _ in range(5):
            async with insider(scene) as client:
                slow = client.get_node(ua.NodeId("Cell", scene.index)).call_method(f"{scene.index}:Slow")
                calling = asyncio.create_task(slow)
                await asyncio.sleep(0)
                client.uaclient.protocol.transport.abort()
                await asyncio.gather(calling, return_exceptions=True)


class Nobody:
    def datachange_notification(self, *_) -> None: ...


async def test_sessions_that_subscribe_and_drop_leave_nothing(scene: Scene):
    async with scene.attack():
        for _ in range(15):
            async with insider(scene) as client:
                subscription = await client.create_subscription(100, Nobody())
                await subscription.subscribe_data_change(client.nodes.server_state)
                client.uaclient.protocol.transport.abort()


async def test_subscriptions_end_with_their_session_even_when_asked_to_stay(scene: Scene):
    async with scene.attack():
        for _ in range(10):
            async with insider(scene) as client:
                for _ in range(10):
                    await client.create_subscription(1000, Nobody())
                await client.uaclient.close_session(False)


async def test_ten_thousand_items_are_too_many(scene: Scene):
    async with scene.attack(), insider(scene) as client:
        subscription = await client.create_subscription(100, Nobody())
        now = client.get_node(Ids.Server_ServerStatus_CurrentTime)
        with pytest.raises(ua.UaError):
            await subscription.subscribe_data_change([now] * 10_000)
        await subscription.subscribe_data_change([now] * 1_000)
        with pytest.raises(ua.uaerrors.BadTooManyMonitoredItems):
            await subscription.subscribe_data_change([now])


async def test_a_flood_of_publish_requests_is_kept_short(scene: Scene):
    async with scene.attack(), insider(scene) as client:
        await client.create_subscription(1000, Nobody())
        protocol = client.uaclient.protocol
        waiting = []
        for _ in range(2_000):
            request = ua.PublishRequest()
            request.Parameters.SubscriptionAcknowledgements = []
            waiting.append(protocol._send_request(request, 60))
        await until(lambda: sum(1 for future in waiting if future.done()) >= 1_900, 30)
        for future in waiting:
            future.cancel()


@pytest.mark.parametrize("timestamp", [0, -1, -(2**63), 2**63 - 1])
async def test_an_old_or_absurd_timestamp_changes_nothing(scene: Scene, timestamp: int):
    async with scene.attack(), insider(scene) as client:
        assert await raw_request(client, READ, many_reads(1), timestamp=timestamp) == Codes.Good


RSA_OAEP = "http://www.w3.org/2001/04/xmlenc#rsa-oaep"


def password(sealed: bytes, algorithm: str | None = None) -> ua.UserNameIdentityToken:
    return ua.UserNameIdentityToken(
        PolicyId="username", UserName="admin", Password=sealed, EncryptionAlgorithm=algorithm
    )


TOKENS = {
    "no token": ua.ExtensionObject(),
    "anonymous": ua.AnonymousIdentityToken(PolicyId="anonymous"),
    "password of garbage": password(b"\0" * 256, RSA_OAEP),
    "password of half a block": password(b"\0" * 100, RSA_OAEP),
    "unknown algorithm": password(b"x", "urn:x"),
    "huge password": password(b"x" * 60_000),
    "no name": ua.UserNameIdentityToken(PolicyId="username"),
    "certificate without signature": ua.X509IdentityToken(PolicyId="certificate", CertificateData=b"garbage"),
    "issued token": ua.IssuedIdentityToken(PolicyId="issued", TokenData=b"x"),
}


@pytest.mark.parametrize("token", TOKENS.values(), ids=TOKENS)
async def test_a_wrong_identity_token_gets_nobody_in(scene: Scene, token):
    async with scene.attack():
        client = await client_of(scene.url, scene.folder)
        await client.connect_socket()
        await client.send_hello()
        await client.open_secure_channel()
        await client.create_session()
        params = ua.ActivateSessionParameters()
        challenge = (client.security_policy.peer_certificate or b"") + client._server_nonce
        params.ClientSignature.Algorithm = client.security_policy.AsymmetricSignatureURI
        params.ClientSignature.Signature = client.security_policy.asymmetric_cryptography.signature(challenge)
        params.UserIdentityToken = token
        with pytest.raises(ua.UaError):
            await client.uaclient.activate_session(params)
        with pytest.raises((ua.UaError, ConnectionError)):
            await client.nodes.server_state.read_value()
        client.disconnect_socket()


async def test_services_the_server_lacks_are_refused(scene: Scene):
    lacking = (
        Ids.QueryFirstRequest_Encoding_DefaultBinary,
        Ids.AddNodesRequest_Encoding_DefaultBinary,
        Ids.DeleteNodesRequest_Encoding_DefaultBinary,
        Ids.HistoryUpdateRequest_Encoding_DefaultBinary,
    )
    async with scene.attack(), insider(scene) as client:
        for kind in lacking:
            assert await raw_request(client, kind, b"\0" * 64) == Codes.BadServiceUnsupported


@pytest.mark.parametrize("interval", [math.nan, math.inf, -1.0, 0.001, 1e308])
async def test_an_absurd_publishing_interval_costs_nothing(scene: Scene, interval: float):
    async with scene.attack(), insider(scene) as client:
        for _ in range(10):
            params = ua.CreateSubscriptionParameters(RequestedPublishingInterval=interval, PublishingEnabled=True)
            await client.uaclient.create_subscription(params, lambda *_: None)


async def test_a_client_that_asks_for_much_and_reads_nothing_is_cut_off(scene: Scene):
    async with scene.attack(), insider(scene) as client:
        await _ask_without_reading(client)


async def _ask_without_reading(client: Client) -> None:
    protocol = client.uaclient.protocol
    protocol.transport.pause_reading()
    body = many_reads(1_000)
    begun = ua.RequestHeader(AuthenticationToken=protocol.authentication_token)
    content = ua.ua_binary.nodeid_to_binary(ua.FourByteNodeId(READ)) + struct_to_binary(begun) + body
    for _ in range(100):
        protocol._request_id += 1
        protocol.transport.write(protocol._connection.message_to_binary(content, request_id=protocol._request_id))
        await asyncio.sleep(0.01)

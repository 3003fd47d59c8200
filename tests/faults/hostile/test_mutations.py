"""Recorded conversations, changed at random: before sign-in on open channels, after it inside an encrypted one."""

import asyncio
import contextlib
import os
import random
import struct
from collections.abc import AsyncIterator

import pytest
from asyncua import Client, ua
from asyncua.ua.ua_binary import struct_to_binary

from tests.faults.hostile.peer import Stranger, chunk, header, hello, insider, open_channel, service, stranger, string
from tests.faults.hostile.scene import Scene

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.slow]

MESSAGES = int(os.environ.get("OPCUA_SKILL_MUTATIONS", "2000"))
SEED = 20261122
INTERESTING = (
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x80",
    b"\xff\xff\xff\x7f",
    b"\xfc\xff\xff\xff",
    b"\0\0\0\0",
    b"\x01\0\0\0",
)
Ids = ua.ObjectIds


def mutated(content: bytes, chance: random.Random) -> bytes:
    """Return a message with one to four changes: bits flipped, lengths made absurd, parts dropped or doubled."""
    changed = bytearray(content)
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(changed) + 1)
        kind = chance.randrange(6)
        if kind == 0 and place < len(changed):
            changed[place] ^= 1 << chance.randrange(8)
        elif kind == 1 and place < len(changed):
            changed[place] = chance.randrange(256)
        elif kind == 2:
            changed[place : place + 4] = chance.choice(INTERESTING)
        elif kind == 3:
            del changed[place : place + chance.randint(1, 40)]
        elif kind == 4:
            changed[place:place] = changed[place : place + chance.randint(1, 40)]
        else:
            changed[place:place] = chance.randbytes(chance.randint(1, 40))
    return bytes(changed)


def before_sign_in() -> list[bytes]:
    """Return what is said before anybody has signed in, message by message."""
    create = ua.CreateSessionParameters(EndpointUrl="opc.tcp://127.0.0.1/", RequestedSessionTimeout=60_000)
    token = ua.UserNameIdentityToken(PolicyId="username", UserName="admin", Password=b"secret")
    activate = ua.ActivateSessionParameters(UserIdentityToken=token)
    bodies = [
        service(Ids.GetEndpointsRequest_Encoding_DefaultBinary)
        + header()
        + string(b"opc.tcp://127.0.0.1/")
        + struct.pack("<ii", 0, 0),
        service(Ids.FindServersRequest_Encoding_DefaultBinary)
        + header()
        + string(b"opc.tcp://127.0.0.1/")
        + struct.pack("<ii", 0, 0),
        service(Ids.CreateSessionRequest_Encoding_DefaultBinary) + header() + struct_to_binary(create),
        service(Ids.ActivateSessionRequest_Encoding_DefaultBinary) + header() + struct_to_binary(activate),
    ]
    return [hello(), open_channel(), *bodies]


def after_sign_in(scene: Scene) -> list[bytes]:
    """Return what is said by somebody who has signed in, as request bodies behind the request header."""
    cell = ua.NodeId("Cell", scene.index)
    call = ua.CallMethodRequest(ObjectId=cell, MethodId=ua.NodeId("Cell/Length", scene.index))
    call.InputArguments = [ua.Variant([1.0, 2.0, 3.0])]
    structure = ua.CallMethodRequest(ObjectId=cell, MethodId=ua.NodeId("Cell/Add", scene.index))
    structure.InputArguments = [ua.Variant(ua.EUInformation()), ua.Variant([[1.0, 2.0], [3.0, 4.0]])]
    read = ua.ReadValueId(
        NodeId=ua.NodeId(Ids.Server_ServerStatus), AttributeId=ua.AttributeIds.Value, IndexRange="1:2"
    )
    write = ua.WriteValue(NodeId=ua.NodeId("Cell/Speed", scene.index), AttributeId=ua.AttributeIds.Value)
    write.Value = ua.DataValue(ua.Variant(2.5))
    browse = ua.BrowseDescription(NodeId=ua.NodeId(Ids.ObjectsFolder), IncludeSubtypes=True)
    path = ua.BrowsePath(StartingNode=ua.NodeId(Ids.ObjectsFolder))
    path.RelativePath.Elements = [ua.RelativePathElement(TargetName=ua.QualifiedName("Server"), IncludeSubtypes=True)]
    item = ua.MonitoredItemCreateRequest()
    item.ItemToMonitor = ua.ReadValueId(NodeId=ua.NodeId(Ids.Server), AttributeId=ua.AttributeIds.EventNotifier)
    wanted = ua.EventFilter()
    wanted.SelectClauses = [ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName("Message")], AttributeId=13)]
    item.RequestedParameters.Filter = wanted

    def many(kind: int, *items) -> bytes:
        return service(kind) + struct.pack("<i", len(items)) + b"".join(struct_to_binary(i) for i in items)

    view = struct_to_binary(ua.ViewDescription()) + struct.pack("<I", 5)
    return [
        many(Ids.CallRequest_Encoding_DefaultBinary, call, structure),
        service(Ids.ReadRequest_Encoding_DefaultBinary) + struct.pack("<dIi", 0.0, 2, 1) + struct_to_binary(read),
        many(Ids.WriteRequest_Encoding_DefaultBinary, write),
        service(Ids.BrowseRequest_Encoding_DefaultBinary) + view + struct.pack("<i", 1) + struct_to_binary(browse),
        many(Ids.TranslateBrowsePathsToNodeIdsRequest_Encoding_DefaultBinary, path),
        service(Ids.CreateSubscriptionRequest_Encoding_DefaultBinary)
        + struct_to_binary(ua.CreateSubscriptionParameters(RequestedPublishingInterval=100.0, PublishingEnabled=True)),
        service(Ids.CreateMonitoredItemsRequest_Encoding_DefaultBinary)
        + struct.pack("<IIi", 78, 2, 1)
        + struct_to_binary(item),
        service(Ids.PublishRequest_Encoding_DefaultBinary) + struct.pack("<i", 0),
        service(Ids.BrowseNextRequest_Encoding_DefaultBinary) + b"\0" + struct.pack("<i", 1) + string(b"x" * 16),
    ]


async def test_mutated_messages_before_sign_in_hurt_nobody(scene: Scene):
    chance, recorded = random.Random(SEED), before_sign_in()
    async with scene.attack():
        for _ in range(MESSAGES // 10):
            async with stranger(scene) as peer:
                with contextlib.suppress(ConnectionError):
                    await _play(peer, recorded, chance)


async def _play(peer: Stranger, recorded: list[bytes], chance: random.Random) -> None:
    """Say a recorded conversation with a change in one message, or in the chunks around the later ones."""
    wrong = chance.randrange(len(recorded))
    for place, content in enumerate(recorded[:2]):
        await peer.send(mutated(content, chance) if place == wrong else content)
    if wrong < 2:
        return
    peer.token = 13
    with contextlib.suppress(TimeoutError, struct.error):
        await peer.answer(2)
        (peer.channel,) = struct.unpack_from("<I", await peer.answer(2), 8)
    for number in range(10):
        body = mutated(chance.choice(recorded[2:]), chance)
        peer.sequence += 1
        whole = chunk(body, channel=peer.channel, token=peer.token, sequence=peer.sequence, request=number)
        await peer.send(mutated(whole, chance) if chance.random() < 0.05 else whole)
    with contextlib.suppress(TimeoutError):
        await peer.answer(0.05)


@contextlib.asynccontextmanager
async def unheard(scene: Scene) -> AsyncIterator[Client]:
    """A signed-in client that does not look at the answers."""
    async with insider(scene) as client:
        client.uaclient.protocol._process_received_data = lambda data: None
        yield client
        if client.uaclient.protocol.transport is not None:
            client.uaclient.protocol.transport.abort()
        await asyncio.sleep(0.05)


async def test_mutated_messages_after_sign_in_hurt_nobody(scene: Scene):
    chance, recorded = random.Random(SEED + 1), after_sign_in(scene)
    sent = 0
    async with scene.attack():
        while sent < MESSAGES:
            async with unheard(scene) as client:
                protocol = client.uaclient.protocol
                begun = struct_to_binary(ua.RequestHeader(AuthenticationToken=protocol.authentication_token))
                for _ in range(200):
                    kind, body = _split(chance.choice(recorded))
                    body = mutated(body, chance)
                    protocol._request_id += 1
                    content = kind + begun + body
                    if protocol.transport is None or protocol.transport.is_closing():
                        break
                    binary = protocol._connection.message_to_binary(content, request_id=protocol._request_id)
                    protocol.transport.write(binary)
                    sent += 1
                    if sent % 20 == 0:
                        await asyncio.sleep(0.01)


def _split(message: bytes) -> tuple[bytes, bytes]:
    return message[:4], message[4:]

"""Recorded conversations, changed at random: before sign-in on open channels, after it inside an encrypted one."""

import asyncio
import contextlib
import os
import random
import struct
from collections.abc import AsyncIterator

import pytest
from asyncua import Client, ua
from asyncua.common.connection import SecureConnection
from asyncua.ua.ua_binary import struct_to_binary

from opcua_skill.stack.transport.chunks import SecureChannel
from tests.faults.hostile.peer import Stranger, chunk, header, hello, insider, open_channel, service, stranger, string
from tests.faults.hostile.scene import Scene

pytestmark = [pytest.mark.asyncio(loop_scope="module"), pytest.mark.slow]

MESSAGES = int(os.environ.get("OPCUA_SKILL_MUTATIONS", "100000"))
BEFORE_SIGN_IN = MESSAGES // 20
A_CONVERSATION, A_SESSION = 25, 5_000
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
LEARN = "SkillLibrary/LearnFromDemonstration"


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
    call = ua.CallMethodRequest(ObjectId=ua.NodeId("SkillLibrary", 3), MethodId=ua.NodeId(LEARN, 3))
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
        service(Ids.CallRequest_Encoding_DefaultBinary) + header() + struct.pack("<i", 1) + struct_to_binary(call),
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


async def product_calls(scene: Scene, client: Client) -> list[bytes]:
    """Return calls of the product's own methods, as request bodies: each is refused as it stands, after its arguments
    have been looked at, so that what is let through by a change is the exception."""
    await client.load_data_type_definitions()
    shape = ua.DemonstrationDataType(DemonstrationId="1", Dimension=2, Operator="eve", Source="recorded")
    shape.Times, shape.Positions = [0.0, 0.1, 0.2], [0.0, 0.0, 0.1, 0.0, 0.1, 0.1]
    shape.RecordedAt = ua.datetime.now(ua.timezone.utc)
    options, recipe = (
        ua.LearningOptionsDataType(Preset="recommended"),
        ua.RecipeDataType(RecipeId="r", SkillName="edge"),
    )
    kind = ua.VariantType
    calls = {
        LEARN: ("edge", "Glue", ua.Variant([shape], kind.ExtensionObject), ua.Variant(options, kind.ExtensionObject)),
        "SkillLibrary/GetTrajectory": ("edge", ua.Variant(1, kind.UInt32), "", 0.01),
        "SkillLibrary/RemovePoints": ("edge", ua.Variant(1, kind.UInt32), "", ua.Variant([1, 2], kind.UInt32), "why"),
        "SkillLibrary/Approve": ("edge", ua.Variant(1, kind.UInt32), b"\0" * 32, "why"),
        "SkillLibrary/FindSkills": ("", "", "", "", "", ua.Variant(10, kind.UInt32)),
        "SkillLibrary/ImportSkill": ("{}", "json"),
        "SkillLibrary/PutRecipe": (ua.Variant(recipe, kind.ExtensionObject),),
        "Machines/ws1/ExecuteSkill": ("edge", "", ua.Variant(0, kind.Int32)),
        "Machines/ws1/GetJob": ("nothing",),
    }
    bodies = []
    for method, arguments in calls.items():
        request = ua.CallMethodRequest(MethodId=ua.NodeId(method, scene.product))
        request.ObjectId = ua.NodeId(method.rpartition("/")[0], scene.product)
        request.InputArguments = [one if isinstance(one, ua.Variant) else ua.Variant(one) for one in arguments]
        (result,) = await client.uaclient.call([request])
        assert result.StatusCode.name != "BadArgumentsMissing", method
        body = struct.pack("<i", 1) + struct_to_binary(request)
        bodies.append(service(Ids.CallRequest_Encoding_DefaultBinary) + body)
    return bodies


async def test_mutated_messages_before_sign_in_hurt_nobody(scene: Scene):
    chance, recorded = random.Random(SEED), before_sign_in()
    async with scene.attack():
        for _ in range(BEFORE_SIGN_IN // A_CONVERSATION):
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
    for number in range(A_CONVERSATION):
        body = mutated(chance.choice(recorded[2:]), chance)
        peer.sequence += 1
        whole = chunk(body, channel=peer.channel, token=peer.token, sequence=peer.sequence, request=number)
        await peer.send(mutated(whole, chance) if chance.random() < 0.05 else whole)
    with contextlib.suppress(TimeoutError):
        while await peer.answer(0.3):
            pass


class Ears:
    """Hears how much is answered, and does not listen to what."""

    def __init__(self) -> None:
        self.heard = 0

    def __call__(self, data: bytes) -> None:
        self.heard += len(data)


@contextlib.asynccontextmanager
async def unheard(scene: Scene) -> AsyncIterator[Client]:
    """A signed-in client that does not look at the answers; it goes when they have stopped coming."""
    async with insider(scene, user="teacher") as client:
        ears = client.uaclient.protocol._process_received_data = Ears()
        yield client
        transport, before = client.uaclient.protocol.transport, -1
        while transport is not None and not transport.is_closing():
            if before == ears.heard and not transport.get_write_buffer_size():
                break
            before = ears.heard
            await asyncio.sleep(0.2)
        if transport is not None:
            transport.abort()
        await asyncio.sleep(0.05)


@pytest.mark.timeout(1200)  # a minute on a quiet machine
async def test_mutated_messages_after_sign_in_hurt_nobody(scene: Scene):
    chance, recorded, sent = random.Random(SEED + 1), after_sign_in(scene), 0
    async with insider(scene, user="engineer") as client:
        product = await product_calls(scene, client)
    async with scene.attack():
        while sent < MESSAGES - BEFORE_SIGN_IN:
            async with unheard(scene) as client:
                sent += await _say(client, recorded, product, chance, min(A_SESSION, MESSAGES - sent))


async def _say(client: Client, recorded: list[bytes], product: list[bytes], chance: random.Random, number: int) -> int:
    """Say so many changed messages in a session, one in fifty of them a call of the product; return how many went."""
    protocol = client.uaclient.protocol
    begun = struct_to_binary(ua.RequestHeader(AuthenticationToken=protocol.authentication_token))
    channel = sending_like(protocol._connection)
    for sent in range(number):
        if protocol.transport is None or protocol.transport.is_closing():
            return sent
        kind, body = _split(chance.choice(product if chance.random() < 0.02 else recorded))
        content = kind + begun + mutated(body, chance)
        protocol.transport.write(channel.message_to_binary(content, request_id=sent + 1_000))
        if sent % 20 == 0:
            while protocol.transport.get_write_buffer_size() > 100_000:
                await asyncio.sleep(0.005)
            await asyncio.sleep(0)
    return number


def sending_like(theirs: SecureConnection) -> SecureChannel:
    """Return a channel that goes on where a client's stands: what it sends costs the test less time."""
    mine = SecureChannel(theirs._limits)
    mine.security_policy, mine.security_token = theirs.security_policy, theirs.security_token
    mine._sequence_number = theirs._sequence_number
    return mine


def _split(message: bytes) -> tuple[bytes, bytes]:
    return message[:4], message[4:]

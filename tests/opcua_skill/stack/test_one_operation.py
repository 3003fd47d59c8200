"""One bad operation costs one result, whatever the service; what clients may leave null or pad is taken."""

import struct
from typing import Any

import pytest
from asyncua import Client, ua
from asyncua.crypto import uacrypto

from opcua_skill.security.access import Peer
from opcua_skill.stack.sessions.sessions import Channel
from opcua_skill.stack.sessions.sign_in import read_password
from tests.opcua_skill.stack.small_server import Bench

pytestmark = pytest.mark.asyncio(loop_scope="package")
Ids, Codes = ua.ObjectIds, ua.StatusCodes
ONE_OF_EACH_CLASS = {
    "object": Ids.Server,
    "variable": Ids.Server_ServerStatus_State,
    "method": Ids.Server_GetMonitoredItems,
    "object type": Ids.BaseObjectType,
    "variable type": Ids.BaseVariableType,
    "reference type": Ids.References,
    "data type": Ids.Structure,
    "no node": 999_999_999,
}
MANDATORY = {ua.AttributeIds.NodeId, ua.AttributeIds.NodeClass, ua.AttributeIds.BrowseName, ua.AttributeIds.DisplayName}


@pytest.mark.parametrize("user", ["observer", "admin"])
async def test_every_attribute_of_every_node_class_has_a_result_of_its_own(bench: Bench, user: str):
    wanted = [
        ua.ReadValueId(NodeId=ua.NodeId(number), AttributeId=attribute)
        for number in ONE_OF_EACH_CLASS.values()
        for attribute in range(31)
    ]
    async with bench.client(user) as client:
        results = await client.uaclient.read(ua.ReadParameters(NodesToRead=wanted))
    assert len(results) == len(wanted)
    for item, told in zip(wanted, results, strict=True):
        good = told.StatusCode is None or told.StatusCode.is_good()
        assert good or told.StatusCode.value in {Codes.BadAttributeIdInvalid, Codes.BadNodeIdUnknown}, (item, told)
        if item.AttributeId in MANDATORY:
            assert good == (item.NodeId.Identifier != 999_999_999), (item, told)
        if item.AttributeId == ua.AttributeIds.UserAccessLevel:
            assert good == (item.NodeId.Identifier == Ids.Server_ServerStatus_State)
        if item.AttributeId == ua.AttributeIds.UserExecutable:
            assert good == (item.NodeId.Identifier == Ids.Server_GetMonitoredItems)


class Broken:
    """A node whose every use goes wrong inside."""

    @property
    def attributes(self) -> Any:
        raise RuntimeError("nobody foresaw this")

    references = attributes


async def test_a_fault_inside_one_operation_costs_its_own_result_alone(bench: Bench):
    broken, good = ua.NodeId("Broken", bench.index), ua.NodeId(Ids.Server_ServerStatus_State)
    bench.server.iserver.aspace._nodes[broken] = Broken()  # pyright: ignore[reportArgumentType]
    try:
        async with bench.client("admin") as client:
            for name, codes in (await every_service(client, broken, good)).items():
                assert codes[0] == Codes.BadInternalError, (name, codes)
                assert codes[1] != Codes.BadInternalError, (name, codes)
    finally:
        del bench.server.iserver.aspace._nodes[broken]


async def every_service(client: Client, broken: ua.NodeId, good: ua.NodeId) -> dict[str, list[int]]:
    """Return the codes of each service for an operation on each of the two nodes."""
    value, session = ua.AttributeIds.Value, client.uaclient
    nodes = (broken, good)
    read = await session.read(ua.ReadParameters(NodesToRead=[ua.ReadValueId(node, value) for node in nodes]))
    item = [ua.WriteValue(node, value, Value=ua.DataValue(ua.Variant(1))) for node in nodes]
    write = await session.write(ua.WriteParameters(NodesToWrite=item))
    both = ua.BrowseDirection.Both
    browsed = [ua.BrowseDescription(NodeId=node, BrowseDirection=both, ResultMask=63) for node in nodes]
    browse = await session.browse(ua.BrowseParameters(NodesToBrowse=browsed))
    element = ua.RelativePathElement(TargetName=ua.QualifiedName("x"))
    paths = [ua.BrowsePath(node, ua.RelativePath(Elements=[element])) for node in nodes]
    translate = await session.translate_browsepaths_to_nodeids(paths)
    calls = [ua.CallMethodRequest(ObjectId=node, MethodId=good) for node in nodes]
    call = await session.call(calls)
    subscription = await client.create_subscription(1000, Nobody())
    items = []
    for handle, node in enumerate(nodes):
        monitored = ua.MonitoredItemCreateRequest(ItemToMonitor=ua.ReadValueId(node, value))
        monitored.MonitoringMode = ua.MonitoringMode.Reporting
        monitored.RequestedParameters.ClientHandle = handle
        items.append(monitored)
    wanted = ua.CreateMonitoredItemsParameters(SubscriptionId=subscription.subscription_id, ItemsToCreate=items)
    wanted.TimestampsToReturn = ua.TimestampsToReturn.Both
    created = await session.create_monitored_items(wanted)
    await subscription.delete()
    return {
        "Read": [one.StatusCode.value for one in read],
        "Write": [one.value for one in write],
        "Browse": [one.StatusCode.value for one in browse],
        "TranslateBrowsePaths": [one.StatusCode.value for one in translate],
        "Call": [one.StatusCode.value for one in call],
        "CreateMonitoredItems": [one.StatusCode.value for one in created],
    }


class Nobody:
    def datachange_notification(self, *_: object) -> None: ...

    def event_notification(self, *_: object) -> None: ...


async def test_a_number_that_names_nothing_costs_its_own_operation(bench: Bench):
    wrong: Any = 7
    described = [
        ua.BrowseDescription(NodeId=ua.NodeId(Ids.Server), BrowseDirection=direction, ResultMask=63)
        for direction in (wrong, ua.BrowseDirection.Forward)
    ]
    async with bench.client() as client:
        first, second = await client.uaclient.browse(ua.BrowseParameters(NodesToBrowse=described))
    assert first.StatusCode.value == Codes.BadBrowseDirectionInvalid
    assert second.StatusCode.is_good() and second.References


def in_list(count: int) -> ua.EventFilter:
    """Return a filter with a list of literals, as python-opcua makes by itself: the type and all its subtypes."""
    wanted = ua.EventFilter()
    wanted.SelectClauses = [ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName("Message")], AttributeId=13)]
    wanted.SelectClauses[0].TypeDefinitionId = ua.NodeId(Ids.BaseEventType)
    element = ua.ContentFilterElement(FilterOperator=ua.FilterOperator.InList)
    field = ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName("EventType")], AttributeId=13)
    literals = [ua.LiteralOperand(Value=ua.Variant(ua.NodeId(one))) for one in range(3_000, 3_000 + count)]
    element.FilterOperands = [field, *literals]
    wanted.WhereClause.Elements = [element]
    return wanted


@pytest.mark.parametrize(("count", "code"), [(300, Codes.Good), (1_001, Codes.BadFilterOperandCountMismatch)])
async def test_a_filter_may_list_many_literals_up_to_a_limit(bench: Bench, count: int, code: int):
    async with bench.client() as client:
        subscription = await client.create_subscription(1000, Nobody())
        item = ua.MonitoredItemCreateRequest(MonitoringMode=ua.MonitoringMode.Reporting)
        item.ItemToMonitor = ua.ReadValueId(ua.NodeId(Ids.Server), ua.AttributeIds.EventNotifier)
        item.RequestedParameters.Filter = in_list(count)
        wanted = ua.CreateMonitoredItemsParameters(subscription.subscription_id, ItemsToCreate=[item])
        wanted.TimestampsToReturn = ua.TimestampsToReturn.Both
        (result,) = await client.uaclient.create_monitored_items(wanted)
    assert result.StatusCode.value == code


ALGORITHM = "http://www.w3.org/2001/04/xmlenc#rsa-oaep"
NONCE = bytes(range(32))
BLOCK = 214


def sealed(bench: Bench, plain: bytes) -> tuple[ua.UserNameIdentityToken, Channel, Any]:
    """Return a token whose secret is encrypted for the server, block by block, with what reading it takes."""
    key = bench.server.iserver.private_key
    encrypt = uacrypto.encrypt_rsa_oaep
    blocks = [plain[at : at + BLOCK] for at in range(0, len(plain), BLOCK)]
    token = ua.UserNameIdentityToken(EncryptionAlgorithm=ALGORITHM)
    token.Password = b"".join(encrypt(key.public_key(), block) for block in blocks)
    return token, Channel("", ua.MessageSecurityMode.SignAndEncrypt, Peer("here", b"")), key


def secret(password: bytes, nonce: bytes = NONCE) -> bytes:
    return struct.pack("<I", len(password) + len(nonce)) + password + nonce


@pytest.mark.parametrize("length", [0, 1, 19, 178, 179, 400])
@pytest.mark.parametrize("padding", ["none", "one byte", "block"])
async def test_a_password_may_be_padded_with_zeros(bench: Bench, length: int, padding: str):
    plain = secret(b"x" * length)
    plain += {"none": b"", "one byte": b"\0", "block": b"\0" * (-len(plain) % BLOCK)}[padding]
    token, channel, key = sealed(bench, plain)
    assert read_password(token, channel, NONCE, key) == "x" * length


WRONG = {
    "padding that is not zero": secret(b"word") + b"\0\0\1",
    "another nonce": secret(b"word", b"\1" * 32) + b"\0" * 100,
    "a nonce of zeros that is padding": secret(b"word", b"") + NONCE,
    "longer than it is": struct.pack("<I", 500) + b"word" + NONCE,
    "shorter than a nonce": struct.pack("<I", 3) + b"word" + NONCE,
    "nothing": b"\0",
}


@pytest.mark.parametrize("plain", WRONG.values(), ids=WRONG)
async def test_a_secret_that_is_not_whole_is_refused(bench: Bench, plain: bytes):
    token, channel, key = sealed(bench, plain)
    with pytest.raises(ua.UaError) as refused:
        read_password(token, channel, NONCE, key)
    assert refused.value.code == Codes.BadIdentityTokenInvalid  # pyright: ignore[reportAttributeAccessIssue]

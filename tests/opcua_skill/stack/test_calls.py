"""What a method call may be, and the exact answer to every one that is not."""

import asyncio
import logging
import math

import pytest
from asyncua import ua

from opcua_skill.security.access import Role, caller
from opcua_skill.stack.services.calls import MethodSpec, Refused, add_method
from tests.opcua_skill.stack.small_server import Bench, until

Codes = ua.StatusCodes
pytestmark = pytest.mark.asyncio(loop_scope="package")


async def call(bench: Bench, name: str, *arguments, user: str = "operator", on: ua.NodeId | None = None):
    """Return the whole CallMethodResult, which asyncua's own call_method hides."""
    async with bench.client(user) as client:
        request = ua.CallMethodRequest()
        request.ObjectId = on or bench.cell
        request.MethodId = ua.NodeId(f"Cell/{name}", bench.index)
        request.InputArguments = [a if isinstance(a, ua.Variant) else ua.Variant(a) for a in arguments]
        return (await client.uaclient.call([request]))[0]


async def test_a_good_call_gets_its_outputs_and_a_good_code_for_each_argument(bench: Bench):
    result = await call(bench, "Add", 1.0, 2.0)
    assert result.StatusCode.is_good()
    assert [v.Value for v in result.OutputArguments] == [3.0]
    assert [code.value for code in result.InputArgumentResults] == [Codes.Good, Codes.Good]


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ((), Codes.BadArgumentsMissing),
        ((1.0,), Codes.BadArgumentsMissing),
        ((1.0, 2.0, 3.0), Codes.BadTooManyArguments),
    ],
)
async def test_a_wrong_number_of_arguments_is_told_apart(bench: Bench, arguments, code):
    result = await call(bench, "Add", *arguments)
    assert result.StatusCode.value == code


@pytest.mark.parametrize(
    "wrong",
    [
        ua.Variant("1.0"),
        ua.Variant(1, ua.VariantType.Int32),
        ua.Variant(True),
        ua.Variant(1.0, ua.VariantType.Float),
        ua.Variant([1.0]),
        ua.Variant(None),
        ua.Variant(ua.EUInformation()),
        ua.Variant([1.0, 2.0], ua.VariantType.Double, [1, 2]),
    ],
    ids=lambda v: f"{v.VariantType.name}{'[]' if v.is_array else ''}",
)
async def test_a_wrong_type_or_rank_points_at_the_argument(bench: Bench, wrong):
    result = await call(bench, "Add", 1.0, wrong)
    assert result.StatusCode.value == Codes.BadInvalidArgument
    assert [code.value for code in result.InputArgumentResults] == [Codes.Good, Codes.BadTypeMismatch]


async def test_a_matrix_is_not_an_array(bench: Bench):
    result = await call(bench, "Length", ua.Variant([[1.0, 2.0], [3.0, 4.0]]))
    assert result.StatusCode.value == Codes.BadInvalidArgument


async def test_a_null_array_arrives_as_an_empty_one(bench: Bench):
    result = await call(bench, "Length", ua.Variant(None, ua.VariantType.Double, is_array=True))
    assert result.OutputArguments[0].Value == 0


async def test_not_a_number_passes_the_stack_because_only_the_method_knows_its_ranges(bench: Bench):
    result = await call(bench, "Add", math.nan, 1.0)
    assert result.StatusCode.is_good()


async def test_a_handler_refuses_with_its_code_and_names_the_argument(bench: Bench):
    result = await call(bench, "Refuse", "x")
    assert result.StatusCode.value == Codes.BadInvalidArgument
    assert [code.value for code in result.InputArgumentResults] == [Codes.BadOutOfRange]
    assert (bench.records[-1].reason, bench.records[-1].arguments) == ("no such name", (("Name", "x"),))


async def test_a_fault_inside_is_internal_and_its_id_is_in_the_log_with_the_traceback(bench: Bench, caplog):
    result = await call(bench, "Fault")
    assert result.StatusCode.value == Codes.BadInternalError
    (entry,) = [record for record in caplog.records if record.exc_info]
    assert "the secret reason" not in bench.records[-1].reason
    assert bench.records[-1].reason.split()[-1] in entry.getMessage()


async def test_a_handler_that_takes_too_long_is_cut_off(bench: Bench):
    result = await call(bench, "Slow")
    assert result.StatusCode.value == Codes.BadTimeout


async def test_a_role_that_may_not_is_refused_before_its_arguments_are_looked_at(bench: Bench):
    assert (await call(bench, "Engineer", "too", "many")).StatusCode.value == Codes.BadUserAccessDenied
    assert (await call(bench, "Engineer", user="engineer")).StatusCode.is_good()


async def test_a_method_of_another_object_cannot_be_called(bench: Bench):
    result = await call(bench, "Add", 1.0, 2.0, on=ua.NodeId(ua.ObjectIds.Server))
    assert result.StatusCode.value == Codes.BadMethodInvalid


async def test_the_declaration_on_the_type_may_be_named_instead_of_the_object_s_own_method(bench: Bench):
    objects, index = bench.server.nodes.base_object_type, bench.index
    kind = await objects.add_object_type(index, "CellType")
    declared = await kind.add_method(
        ua.NodeId("CellType/Add", index), ua.QualifiedName("Add", index), lambda parent: []
    )
    cell = bench.server.get_node(bench.cell)
    await cell.delete_reference(ua.ObjectIds.BaseObjectType, ua.ObjectIds.HasTypeDefinition)
    await cell.add_reference(kind, ua.ObjectIds.HasTypeDefinition, bidirectional=False)
    async with bench.client() as client:
        assert await client.get_node(bench.cell).call_method(declared.nodeid, 1.0, 2.0) == 3.0


async def test_an_unknown_object_or_method_is_told_apart(bench: Bench):
    nowhere = ua.NodeId("nowhere", bench.index)
    assert (await call(bench, "Add", 1.0, 2.0, on=nowhere)).StatusCode.value == Codes.BadNodeIdUnknown
    assert (await call(bench, "Nothing")).StatusCode.value == Codes.BadMethodInvalid


async def test_a_standard_method_that_this_server_has_not_is_none(bench: Bench):
    async with bench.client() as client:
        server = client.get_node(ua.ObjectIds.Server)
        with pytest.raises(ua.uaerrors.BadMethodInvalid):
            await server.call_method(ua.NodeId(ua.ObjectIds.Server_RequestServerStateChange))


async def test_a_method_that_is_not_executable_now_is_not_called(bench: Bench):
    node = bench.server.get_node(ua.NodeId("Cell/Add", bench.index))
    await node.write_attribute(ua.AttributeIds.Executable, ua.DataValue(False))
    assert (await call(bench, "Add", 1.0, 2.0)).StatusCode.value == Codes.BadNotExecutable
    await node.write_attribute(ua.AttributeIds.Executable, ua.DataValue(True))


async def test_calls_that_change_something_and_refusals_are_recorded_others_are_not(bench: Bench):
    await call(bench, "Add", 1.0, 2.0)
    assert bench.records == []
    await call(bench, "WhoAmI")
    await call(bench, "Add", 1.0)
    assert [(r.method_name, r.status_name) for r in bench.records] == [
        ("WhoAmI", "Good"),
        ("Add", "BadArgumentsMissing"),
    ]
    assert bench.records[0].caller.name == "operator"


async def test_a_secret_argument_never_reaches_record_or_log(bench: Bench, caplog):
    caplog.set_level(logging.DEBUG)
    await call(bench, "Secret", "open sesame")
    assert bench.records[-1].arguments == (("Password", "***"),)
    assert "open sesame" not in caplog.text


async def test_the_handler_knows_who_calls_and_nobody_calls_outside(bench: Bench):
    assert (await call(bench, "WhoAmI", user="teacher")).OutputArguments[0].Value == "teacher/teacher"
    with pytest.raises(LookupError):
        caller()


async def test_callers_of_concurrent_calls_are_not_mixed_up(bench: Bench):
    users = ["observer", "operator", "teacher", "engineer"] * 3
    answers = await asyncio.gather(*(call(bench, "WhoAmI", user=user) for user in users))
    assert [a.OutputArguments[0].Value for a in answers] == [f"{user}/{user}" for user in users]


async def test_user_executable_is_told_truly_to_each_session(bench: Bench):
    node_id = ua.NodeId("Cell/Engineer", bench.index)
    for user, may in (("operator", False), ("engineer", True)):
        async with bench.client(user) as client:
            told = await client.get_node(node_id).read_attribute(ua.AttributeIds.UserExecutable)
            assert told.Value.Value is may


async def test_arguments_are_described_for_strict_clients(bench: Bench):
    async with bench.client() as client:
        node = await client.get_node(ua.NodeId("Cell/Length", bench.index)).get_child("0:InputArguments")
        (argument,) = await node.read_value()
        assert (argument.Name, argument.ValueRank, argument.ArrayDimensions) == ("Values", 1, [0])
        assert argument.DataType == ua.NodeId(ua.ObjectIds.Double)


async def test_a_variable_is_written_only_by_roles_that_may(bench: Bench):
    async def write(user: str, name: str) -> None:
        async with bench.client(user) as client:
            await client.get_node(ua.NodeId(f"Cell/{name}", bench.index)).write_value(9.0)

    await write("operator", "Speed")
    await write("engineer", "Locked")
    for user, name in (("observer", "Speed"), ("operator", "Locked")):
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await write(user, name)
    with pytest.raises(ua.uaerrors.BadNotWritable):
        await write("admin", "ReadOnly")


async def test_user_access_level_is_told_truly_to_each_session(bench: Bench):
    for user, levels in (("operator", {"Speed": True, "Locked": False}), ("engineer", {"Speed": True, "Locked": True})):
        async with bench.client(user) as client:
            for name, may in levels.items():
                level = await client.get_node(ua.NodeId(f"Cell/{name}", bench.index)).get_user_access_level()
                assert (ua.AccessLevel.CurrentWrite in level) is may


async def test_a_variable_that_commands_is_obeyed_before_it_is_written_or_refused(bench: Bench):
    node_id, obeyed = ua.NodeId("Cell/Speed", bench.index), []

    async def obey(value) -> None:
        if value > 2.0:
            raise Refused(Codes.BadOutOfRange, "too fast")
        obeyed.append((caller().name, value))

    bench.server.obey_writes(node_id, obey)
    async with bench.client() as client:
        speed = client.get_node(node_id)
        await speed.write_value(1.25)
        with pytest.raises(ua.uaerrors.BadOutOfRange):
            await speed.write_value(3.0)
        assert (obeyed, await speed.read_value()) == ([("operator", 1.25)], 1.25)
    del bench.server.iserver.on_write[node_id]


async def test_a_call_that_changes_something_ends_even_when_its_client_goes_away(bench: Bench):
    entered, ended, go_on = asyncio.Event(), asyncio.Event(), asyncio.Event()

    async def change() -> tuple[()]:
        entered.set()
        await go_on.wait()
        ended.set()
        return ()

    spec = MethodSpec("Change", (), (), change, Role.OPERATOR.and_above, changes=True)
    place = ua.NodeId("Cell/Change", bench.index)
    await add_method(bench.server, bench.cell, spec, place, ua.QualifiedName("Change", bench.index))
    client = await bench.new_client()
    await client.connect()
    calling = asyncio.create_task(client.get_node(bench.cell).call_method(place))
    async with asyncio.timeout(10):
        await entered.wait()
        client.uaclient.protocol.transport.abort()
        await asyncio.gather(calling, client.disconnect(), return_exceptions=True)
        go_on.set()
        await ended.wait()
    await until(lambda: [record.method_name for record in bench.records] == ["Change"])


async def test_a_call_that_takes_long_does_not_hold_up_the_next_requests_of_its_client(bench: Bench):
    async with bench.client() as client:
        slow = asyncio.create_task(client.get_node(bench.cell).call_method(f"{bench.index}:Slow"))
        await asyncio.sleep(0)
        assert await client.nodes.server_state.read_value() == 0
        assert not slow.done()
        with pytest.raises(ua.uaerrors.BadTimeout):
            await slow

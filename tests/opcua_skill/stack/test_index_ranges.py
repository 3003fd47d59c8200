"""Parts of values: what numpy slices, a client reads, writes and monitors; everything else has its exact code."""

import math

import numpy as np
import pytest
import pytest_asyncio
from asyncua import Client, ua
from hypothesis import given, settings
from hypothesis import strategies as st

from opcua_skill.stack.services.index_ranges import index_range, part_of, with_part
from tests.opcua_skill.stack.small_server import Bench, until

Codes = ua.StatusCodes
DOUBLE = ua.VariantType.Double


def as_variant(values: np.ndarray) -> ua.Variant:
    return ua.Variant(values.tolist(), DOUBLE, list(values.shape) if values.ndim > 1 else None, is_array=True)


def as_text(ranges: list[tuple[int, int]]) -> str:
    return ",".join(str(first) if first == last else f"{first}:{last}" for first, last in ranges)


shapes = st.lists(st.integers(1, 5), min_size=1, max_size=3)
one_range = st.tuples(st.integers(0, 6), st.integers(0, 6)).map(lambda ends: (min(ends), max(ends)))


@settings(deadline=None)
@given(shapes, st.data())
def test_a_part_that_is_read_is_what_numpy_slices(shape: list[int], data: st.DataObject):
    values = np.arange(math.prod(shape), dtype=float).reshape(shape)
    ranges = data.draw(st.lists(one_range, min_size=len(shape), max_size=len(shape)))
    told = part_of(as_variant(values), index_range(as_text(ranges)))
    if any(first >= size for (first, _), size in zip(ranges, shape, strict=True)):
        assert told is None
    else:
        expected = values[tuple(slice(first, last + 1) for first, last in ranges)]
        assert (told.Value, told.Dimensions or [len(told.Value)]) == (expected.tolist(), list(expected.shape))


@settings(deadline=None)
@given(shapes, st.data())
def test_a_part_that_is_written_is_what_numpy_assigns(shape: list[int], data: st.DataObject):
    values = np.arange(math.prod(shape), dtype=float).reshape(shape)
    ranges = data.draw(st.lists(one_range, min_size=len(shape), max_size=len(shape)))
    sizes = [last - first + 1 for first, last in ranges]
    part = -1.0 - np.arange(math.prod(sizes), dtype=float).reshape(sizes)
    before = as_variant(values)
    done = with_part(before, index_range(as_text(ranges)), as_variant(part))
    assert before == as_variant(values)
    if any(last >= size for (_, last), size in zip(ranges, shape, strict=True)):
        assert done == Codes.BadIndexRangeNoData
    else:
        values[tuple(slice(first, last + 1) for first, last in ranges)] = part
        assert done == as_variant(values)
        assert done.Dimensions == before.Dimensions


@settings(deadline=None)
@given(st.one_of(st.text(max_size=8), st.binary(max_size=8)), one_range, st.data())
def test_a_part_of_text_is_a_slice_and_keeps_its_length_when_written(whole, ends: tuple[int, int], data: st.DataObject):
    first, last = ends
    ranges, value = index_range(as_text([ends])), ua.Variant(whole)
    told = part_of(value, ranges)
    assert (told.Value if told is not None else None) == (whole[first : last + 1] or None)
    new = data.draw(st.text(max_size=8) if isinstance(whole, str) else st.binary(max_size=8))
    done = with_part(value, ranges, ua.Variant(new))
    if last >= len(whole):
        assert done == Codes.BadIndexRangeNoData
    elif len(new) != last - first + 1:
        assert done == Codes.BadIndexRangeDataMismatch
    else:
        assert done.Value == whole[:first] + new + whole[last + 1 :]


@given(st.text(st.sampled_from("0123456789:, x"), max_size=8))
def test_an_index_range_is_numbers_that_rise_or_it_is_none(asked: str):
    try:
        pairs = [[int(end) for end in part.split(":")] for part in asked.split(",")]
        good = " " not in asked and all(len(p) == 1 or (len(p) == 2 and p[0] < p[1]) for p in pairs)
    except ValueError:
        good = False
    ranges = index_range(asked)
    assert (ranges is not None) == good
    if ranges is not None:
        assert [[r.start, r.stop - 1] for r in ranges] == [[p[0], p[-1]] for p in pairs]


def test_a_flat_value_with_dimensions_is_the_same_matrix():
    flat = ua.Variant([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], DOUBLE, [2, 3], is_array=True)
    assert part_of(flat, index_range("1,1:2")).Value == [[5.0, 6.0]]
    assert with_part(flat, index_range("0,0"), ua.Variant([[9.0]])).Value == [[9.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_a_range_of_very_many_dimensions_is_none_at_once():
    assert index_range("0," * 1_000_000 + "0") is None


CONTENTS = {
    "Row": [1.0, 2.0, 3.0, 4.0],
    "Matrix": [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]],
    "Names": ["TestString", "Test", "String"],
    "Bytes": b"0123456789",
    "Word": "weld",
    "Number": 1.5,
}
pytest_stack = pytest.mark.asyncio(loop_scope="package")


@pytest_asyncio.fixture(loop_scope="package")
async def values(bench: Bench) -> dict[str, ua.NodeId]:
    """Writable variables of each kind, with their first contents again for each test."""
    found = {}
    for name, content in CONTENTS.items():
        found[name] = ua.NodeId(f"Cell/Parts/{name}", bench.index)
        if found[name] not in bench.server.iserver.aspace:
            node = await bench.server.get_node(bench.cell).add_variable(found[name], name, content)
            await node.set_writable()
        await bench.server.get_node(found[name]).write_value(content)
    return found


async def read(client: Client, node: ua.NodeId, part: str, attribute: int = 13, encoding: str | None = None):
    wanted = ua.ReadValueId(NodeId=node, AttributeId=attribute, IndexRange=part)
    wanted.DataEncoding = ua.QualifiedName(encoding)
    (told,) = await client.uaclient.read(ua.ReadParameters(NodesToRead=[wanted]))
    return told.Value.Value if told.Value is not None and told.StatusCode.is_good() else told.StatusCode.name


READS = [
    ("Row", "1", [2.0]),
    ("Row", "1:2", [2.0, 3.0]),
    ("Row", "2:99", [3.0, 4.0]),
    ("Row", "4", "BadIndexRangeNoData"),
    ("Row", "0,0", "BadIndexRangeNoData"),
    ("Row", "2:1", "BadIndexRangeInvalid"),
    ("Row", "2:2", "BadIndexRangeInvalid"),
    ("Row", "-1", "BadIndexRangeInvalid"),
    ("Row", "1 ", "BadIndexRangeInvalid"),
    ("Row", "1:", "BadIndexRangeInvalid"),
    ("Row", ",", "BadIndexRangeInvalid"),
    ("Row", "٣", "BadIndexRangeInvalid"),
    ("Matrix", "1,0:1", [[4.0, 5.0]]),
    ("Matrix", "0:1,2", [[3.0], [6.0]]),
    ("Matrix", "0:7,2:7", [[3.0], [6.0]]),
    ("Matrix", "1", "BadIndexRangeNoData"),
    ("Matrix", "0,3", "BadIndexRangeNoData"),
    ("Names", "0:1", ["TestString", "Test"]),
    ("Names", "0:2,7:9", ["ing", None, None]),
    ("Names", "1:2,7:9", "BadIndexRangeNoData"),
    ("Bytes", "3:4", b"34"),
    ("Word", "1:2", "el"),
    ("Word", "4", "BadIndexRangeNoData"),
    ("Word", "0,0", "BadIndexRangeNoData"),
    ("Number", "0", "BadIndexRangeNoData"),
]


@pytest_stack
async def test_a_part_is_read_or_its_absence_has_its_code(bench: Bench, values):
    async with bench.client() as client:
        told = [(name, part, await read(client, values[name], part)) for name, part, _ in READS]
    assert told == READS


@pytest_stack
async def test_an_encoding_is_asked_of_structures_only(bench: Bench, values):
    status = ua.NodeId(ua.ObjectIds.Server_ServerStatus)
    async with bench.client() as client:
        assert isinstance(await read(client, status, "", encoding="Default Binary"), ua.ServerStatusDataType)
        assert await read(client, status, "", encoding="Default XML") == "BadDataEncodingUnsupported"
        assert await read(client, status, "", encoding="Mine") == "BadDataEncodingInvalid"
        assert await read(client, values["Row"], "", encoding="Default Binary") == "BadDataEncodingInvalid"
        assert await read(client, status, "", ua.AttributeIds.DisplayName, "Default XML") == "BadDataEncodingInvalid"


WRITES = [
    ("Row", "1", [9.0], [1.0, 9.0, 3.0, 4.0]),
    ("Row", "1:2", [8.0, 9.0], [1.0, 8.0, 9.0, 4.0]),
    ("Row", "1:2", [9.0], "BadIndexRangeDataMismatch"),
    ("Row", "1", 9.0, "BadTypeMismatch"),
    ("Row", "1", ["9"], "BadTypeMismatch"),
    ("Row", "1", ua.Variant(None, DOUBLE, is_array=True), "BadIndexRangeDataMismatch"),
    ("Row", "1", ua.Variant(None, ua.VariantType.Null), "BadTypeMismatch"),
    ("Row", "3:4", [8.0, 9.0], "BadIndexRangeNoData"),
    ("Row", "1,1", [[9.0]], "BadIndexRangeNoData"),
    ("Row", "2:1", [9.0], "BadIndexRangeInvalid"),
    ("Matrix", "0:1,1", [[8.0], [9.0]], [[1.0, 8.0, 3.0], [4.0, 9.0, 6.0]]),
    ("Matrix", "0:1,1", [8.0, 9.0], "BadIndexRangeDataMismatch"),
    ("Matrix", "0:1,1", [[8.0, 9.0]], "BadIndexRangeDataMismatch"),
    ("Matrix", "1", [9.0], "BadIndexRangeNoData"),
    ("Names", "1", ["Rest"], ["TestString", "Rest", "String"]),
    ("Names", "0:1,0:1", ["BU", "ta"], ["BUstString", "tast", "String"]),
    ("Names", "0:1,4:5", ["BU", "ta"], "BadIndexRangeNoData"),
    ("Names", "0:1,0:1", ["BU", "t"], "BadIndexRangeDataMismatch"),
    ("Bytes", "3:4", b"xy", b"012xy56789"),
    ("Bytes", "3:4", "xy", "BadTypeMismatch"),
    ("Word", "0", "m", "meld"),
    ("Word", "3:4", "ds", "BadIndexRangeNoData"),
    ("Number", "0", 2.5, "BadIndexRangeNoData"),
]


@pytest_stack
async def test_a_part_is_written_whole_or_nothing_is(bench: Bench, values):
    async with bench.client() as client:
        for name, part, content, expected in WRITES:
            content = content if isinstance(content, ua.Variant) else ua.Variant(content)
            item = ua.WriteValue(NodeId=values[name], AttributeId=13, IndexRange=part, Value=ua.DataValue(content))
            (code,) = await client.uaclient.write(ua.WriteParameters(NodesToWrite=[item]))
            refused = isinstance(expected, str) and expected.startswith("Bad")
            assert code.name == (expected if refused else "Good"), (name, part, content)
            now = await client.get_node(values[name]).read_value()
            assert now == (CONTENTS[name] if refused else expected), (name, part, content)
            await bench.server.get_node(values[name]).write_value(CONTENTS[name])


@pytest_stack
async def test_what_commands_something_is_written_whole(bench: Bench, values):
    async def obey(_: list[float]) -> None:
        raise AssertionError("half a command was obeyed")

    item = ua.WriteValue(NodeId=values["Row"], AttributeId=13, IndexRange="1", Value=ua.DataValue([9.0]))
    bench.server.obey_writes(values["Row"], obey)
    try:
        async with bench.client() as client:
            (code,) = await client.uaclient.write(ua.WriteParameters(NodesToWrite=[item]))
    finally:
        del bench.server.iserver.on_write[values["Row"]]
    assert code.name == "BadWriteNotSupported"


@pytest_stack
async def test_two_parts_in_one_request_are_both_written(bench: Bench, values):
    items = [
        ua.WriteValue(NodeId=values["Row"], AttributeId=13, IndexRange=part, Value=ua.DataValue(content))
        for part, content in (("0", [7.0]), ("2:3", [8.0, 9.0]))
    ]
    async with bench.client() as client:
        await client.uaclient.write(ua.WriteParameters(NodesToWrite=items))
        assert await client.get_node(values["Row"]).read_value() == [7.0, 2.0, 8.0, 9.0]


class Told:
    def __init__(self) -> None:
        self.seen: list = []

    def datachange_notification(self, node, value, data) -> None:
        status = data.monitored_item.Value.StatusCode
        self.seen.append(value if status.is_good() else status.name)


@pytest_stack
async def test_a_part_is_monitored_and_told_only_when_it_changes(bench: Bench, values):
    async with bench.client() as client:
        told = Told()
        subscription = await client.create_subscription(50, told)
        request = subscription._make_monitored_item_request(
            client.get_node(values["Row"]), 13, None, 10, ua.MonitoringMode.Reporting, 0.0
        )
        request.ItemToMonitor.IndexRange = "1:2"
        await subscription.create_monitored_items([request])
        await until(lambda: told.seen == [[2.0, 3.0]])
        row = bench.server.get_node(values["Row"])
        for content in ([9.0, 2.0, 3.0, 4.0], [9.0, 2.0, 5.0, 4.0], [9.0], [9.0, 2.0]):
            await row.write_value(content)
        await until(lambda: told.seen[1:] == [[2.0, 5.0], "BadIndexRangeNoData", [2.0]])
        request.ItemToMonitor.IndexRange = "2:1"
        (refused,) = await subscription.create_monitored_items([request])
        assert refused.name == "BadIndexRangeInvalid"

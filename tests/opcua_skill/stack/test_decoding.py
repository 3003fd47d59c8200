"""The guarded decoders read what asyncua writes, and nothing that no honest client would write."""

import math
import struct
import uuid
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime

import pytest
from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.ua import uaerrors
from asyncua.ua.ua_binary import struct_from_binary, struct_to_binary, variant_from_binary, variant_to_binary
from hypothesis import given, settings
from hypothesis import strategies as st

from opcua_skill.stack.limits import Limits
from opcua_skill.stack.transport.decoding import MALFORMED, decode, install, reshape

REFUSED = (uaerrors.BadDecodingError, uaerrors.BadEncodingLimitsExceeded)
text = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"))
scalars = st.one_of(
    st.builds(ua.Variant, st.floats(allow_nan=False), st.just(ua.VariantType.Double)),
    st.builds(ua.Variant, st.integers(-(2**31), 2**31 - 1), st.just(ua.VariantType.Int32)),
    st.builds(ua.Variant, st.booleans(), st.just(ua.VariantType.Boolean)),
    st.builds(ua.Variant, text, st.just(ua.VariantType.String)),
    st.builds(ua.Variant, st.binary(), st.just(ua.VariantType.ByteString)),
    st.builds(ua.Variant, st.uuids(), st.just(ua.VariantType.Guid)),
    st.builds(ua.Variant, st.lists(st.floats(allow_nan=False)), st.just(ua.VariantType.Double)),
    st.builds(ua.Variant, st.lists(text), st.just(ua.VariantType.String)),
    st.builds(
        ua.Variant,
        st.lists(st.builds(ua.EUInformation, UnitId=st.integers(0, 99))),
        st.just(ua.VariantType.ExtensionObject),
    ),
)


@pytest.fixture(autouse=True)
def guarded():
    install(Limits())


@settings(deadline=None)
@given(scalars)
def test_what_is_encoded_is_decoded_to_the_same_value(variant: ua.Variant):
    assert variant_from_binary(Buffer(variant_to_binary(variant))) == variant


@settings(deadline=None)
@given(st.lists(st.integers(1, 4), min_size=2, max_size=4))
def test_a_matrix_keeps_its_shape(dimensions: list[int]):
    flat = [float(value) for value in range(math.prod(dimensions))]
    value = reshape(flat, dimensions)
    decoded = variant_from_binary(Buffer(variant_to_binary(ua.Variant(value, ua.VariantType.Double))))
    assert (decoded.Value, decoded.Dimensions) == (value, dimensions)


def test_nested_variants_and_structures_come_back_whole():
    inner = ua.Variant([ua.Variant(1.0), ua.Variant("two"), ua.Variant(uuid.uuid4())], ua.VariantType.Variant)
    assert variant_from_binary(Buffer(variant_to_binary(inner))) == inner
    request = ua.CallMethodRequest(InputArguments=[inner, ua.Variant(datetime(2026, 1, 1, tzinfo=UTC))])
    assert struct_from_binary(ua.CallMethodRequest, Buffer(struct_to_binary(request))) == request


@settings(deadline=None, max_examples=300)
@given(st.binary(max_size=200))
def test_random_bytes_are_a_value_or_a_refusal(content: bytes):
    for kind in (ua.CallParameters, ua.RequestHeader, ua.CreateMonitoredItemsParameters, ua.ActivateSessionParameters):
        try:
            decode(kind, Buffer(content))
        except REFUSED:
            continue


def array(kind: ua.VariantType, count: int, content: bytes = b"") -> Buffer:
    return Buffer(struct.pack("<Bi", kind.value | 0x80, count) + content)


@pytest.mark.parametrize(
    "kind", [ua.VariantType.Null, ua.VariantType.Double, ua.VariantType.String, ua.VariantType.Variant]
)
@pytest.mark.parametrize("count", [-2, -(2**31), 2**31 - 1, 100])
def test_an_array_cannot_announce_more_than_it_brings(kind: ua.VariantType, count: int):
    with pytest.raises((*REFUSED, ua.UaError)):
        variant_from_binary(array(kind, count))


def test_a_negative_length_never_moves_the_reader_backwards():
    buffer = Buffer(b"abcdef")
    buffer.read(4)
    for back in (lambda: buffer.read(-4), lambda: buffer.skip(-4)):
        with pytest.raises((*REFUSED, ua.UaError)):
            back()
    assert len(buffer) == 2


def test_arrays_of_other_than_numbers_are_limited():
    install(Limits(array_of_others=3))
    fits, too_many = (variant_to_binary(ua.Variant(["a"] * n)) for n in (3, 4))
    assert variant_from_binary(Buffer(fits)).Value == ["a"] * 3
    with pytest.raises(uaerrors.BadEncodingLimitsExceeded):
        variant_from_binary(Buffer(too_many))


def test_arrays_within_the_limit_must_not_add_up():
    install(Limits(array_of_others=10, elements_per_message=30))
    row = ua.Variant(["a"] * 9)
    fits, too_many = (ua.CallMethodRequest(InputArguments=[row] * n) for n in (2, 4))
    assert decode(ua.CallMethodRequest, Buffer(struct_to_binary(fits))) == fits
    with pytest.raises(uaerrors.BadEncodingLimitsExceeded):
        decode(ua.CallMethodRequest, Buffer(struct_to_binary(too_many)))


@pytest.mark.parametrize("content", [b"\xff\xfe", b"\xed\xa0\x80", b"a\0b"])
def test_text_is_utf_8_without_nul(content: bytes):
    with pytest.raises(uaerrors.BadDecodingError):
        variant_from_binary(Buffer(struct.pack("<Bi", 12, len(content)) + content))


def test_dimensions_must_say_how_many_values_there_are():
    matrix = bytearray(variant_to_binary(ua.Variant([[1.0, 2.0], [3.0, 4.0]])))
    matrix[-8:] = struct.pack("<ii", 999, 1001)
    with pytest.raises(uaerrors.BadDecodingError):
        variant_from_binary(Buffer(bytes(matrix)))


def test_nesting_has_an_end():
    content = b"\x98" + struct.pack("<i", 1)
    with pytest.raises(uaerrors.BadEncodingLimitsExceeded):
        variant_from_binary(Buffer(content * 10_000))


def test_a_structure_with_a_foreign_body_stays_raw_so_that_the_argument_can_be_named():
    good = variant_to_binary(ua.Variant(ua.EUInformation(UnitId=7)))
    assert variant_from_binary(Buffer(good)).Value.UnitId == 7
    longer = bytearray(good + b"\0\0")
    place = good.index(struct.pack("<i", len(good) - good.index(b"\x01", 4) - 5))
    longer[place : place + 4] = struct.pack("<i", struct.unpack_from("<i", good, place)[0] + 2)
    assert isinstance(variant_from_binary(Buffer(bytes(longer))).Value, ua.ExtensionObject)


def test_what_decoding_raises_is_known():
    assert issubclass(uaerrors.BadDecodingError, MALFORMED)


def test_what_one_thread_decodes_is_not_counted_against_another():
    few = Limits(elements_per_message=2000)
    install(few)
    body = struct_to_binary(ua.ReadParameters(NodesToRead=[ua.ReadValueId() for _ in range(1500)]))
    with ThreadPoolExecutor(4) as threads:
        for read in [threads.submit(decode, ua.ReadParameters, Buffer(body)) for _ in range(12)]:
            assert len(read.result().NodesToRead) == 1500

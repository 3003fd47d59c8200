"""How asyncua's own decoders read what ours refuse. A test that fails here says which of ours may go.

Ours are put in place once per process, so these tests load asyncua's modules a second time, beside those in use.
"""

import importlib.util
import struct
from types import ModuleType

import numpy as np
import pytest
from asyncua import ua

from opcua_skill.stack.limits import Limits


def untouched(name: str) -> ModuleType:
    spec = importlib.util.find_spec(name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


binary, utils = untouched("asyncua.ua.ua_binary"), untouched("asyncua.common.utils")


def buffer(content: bytes):
    return utils.Buffer(content)


def mended(what: str) -> str:
    return f"asyncua mends this: {what}. See whether opcua_skill/stack/transport/decoding.py can do without it"


def test_a_buffer_is_read_backwards():
    for step in ("read", "skip"):
        data = buffer(b"abcdef")
        data.read(4)
        getattr(data, step)(-2)
        assert data.read(2) == b"cd", mended(f"Buffer.{step} refuses negative sizes")


def test_a_length_below_nothing_is_taken():
    below = struct.pack("<i", -5)
    for name, read in (
        ("_Bytes", binary._Bytes.unpack),
        ("arrays", binary._create_uatype_array_deserializer(ua.VariantType.String)),
        ("lists", binary._create_list_deserializer(ua.Argument)),
    ):
        assert not read(buffer(below)), mended(f"{name} refuse negative lengths")


def test_text_may_be_anything():
    for content in (b"\xff", b"\0"):
        text = binary._String.unpack(buffer(struct.pack("<i", 1) + content))
        assert len(text) == 1, mended("text that is not UTF-8 or holds NUL is refused")


def test_nesting_has_no_end():
    deep = 2 * Limits().nesting
    value = binary.variant_from_binary(buffer(b"\x18" * deep + b"\x01\x01"))
    assert value.Value is True, mended("nesting is limited")


def test_dimensions_need_not_fit():
    assert binary._reshape([1.0], [2]) == [1.0, []], mended("dimensions must fit their array")


def test_a_structure_with_a_foreign_body_is_a_fault():
    number = ua.ObjectIds.Argument_Encoding_DefaultBinary
    body = b"\x01\x00" + struct.pack("<H", number) + b"\x01" + struct.pack("<i", 1) + b"\x07"
    with pytest.raises(utils.NotEnoughData):
        pytest.fail(
            mended(f"one that cannot be read stays as bytes ({binary.extensionobject_from_binary(buffer(body))})")
        )


def test_a_number_without_a_name_is_a_fault():
    with pytest.raises(ValueError, match="99"):
        read = binary.create_enum_deserializer(ua.BrowseDirection)(buffer(struct.pack("<i", 99)))
        pytest.fail(mended(f"an enumeration keeps a number that has no name ({read})"))


def test_an_array_that_is_no_list_is_lost():
    packed = binary.Primitives1.Double.pack_array(np.zeros(3))
    assert packed == struct.pack("<i", -1), mended("arrays of numpy are encoded")


def test_a_field_called_encoding_is_a_byte():
    record = ua.SessionSecurityDiagnosticsDataType()
    assert record.Encoding == 0 and not isinstance(record.Encoding, str), (
        "asyncua mends SessionSecurityDiagnosticsDataType: take out security_record of diagnostic_records.py"
    )

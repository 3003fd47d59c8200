"""From Variant to Python value and back, by the declared data type; what does not fit is told apart, not guessed."""

import dataclasses
import functools
import typing
from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np
from asyncua import ua
from asyncua.server.address_space import AddressSpace
from asyncua.ua import ua_binary
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.stack.address_space.values import node_id

ArgumentCheck = Callable[[ua.Variant], tuple[bool, Any]]
"""Returns whether a Variant fits, and its Python value (with null strings and arrays as empty ones) if it does."""

_NUMBERS = frozenset(range(2, 12))
_ABSTRACT: dict[int, frozenset[int]] = {
    Ids.BaseDataType: frozenset(range(1, 26)),
    Ids.Number: _NUMBERS,
    Ids.Integer: frozenset({2, 4, 6, 8}),
    Ids.UInteger: frozenset({3, 5, 7, 9}),
    Ids.Enumeration: frozenset({6}),
}
_HAS_SUBTYPE = node_id(Ids.HasSubtype)


def builtin_types(aspace: AddressSpace, data_type: ua.NodeId) -> frozenset[int]:
    """Return the built-in types (OPC 10000-6, table 1) whose values a variable of this data type may hold."""
    at: ua.NodeId | None = data_type
    while at is not None:
        if at.NamespaceIndex == 0 and isinstance(at.Identifier, int):
            if at.Identifier in _ABSTRACT:
                return _ABSTRACT[at.Identifier]
            if 1 <= at.Identifier <= 25:
                return frozenset({at.Identifier})
        node = aspace.get(at)
        above = (
            [r.NodeId for r in node.references if r.ReferenceTypeId == _HAS_SUBTYPE and not r.IsForward] if node else []
        )
        at = above[0] if above else None
    raise ValueError(f"{data_type.to_string()} is not a data type of this server")


def compile_check(aspace: AddressSpace, data_type: ua.NodeId, rank: int) -> ArgumentCheck:
    """Return the check for one argument: right built-in type, right rank, right structure class, known enum value."""
    allowed = builtin_types(aspace, data_type)
    structures = _classes(aspace, data_type)
    enumeration = ua.enums_by_datatype.get(data_type)
    empty: Any = {12: "", 15: b""}.get(next(iter(allowed))) if len(allowed) == 1 else None
    is_structure = allowed == {22}

    def element(value: Any) -> tuple[bool, Any]:
        if is_structure:
            fits = isinstance(value, structures) if structures else value is not None
            return fits, _without_nulls(value) if fits else value
        if enumeration is not None:
            return _is_member(enumeration, value), value
        return True, empty if value is None else value

    plain = not is_structure and enumeration is None

    def check_scalar(variant: ua.Variant) -> tuple[bool, Any]:
        if variant.is_array or variant.VariantType.value not in allowed:
            return False, None
        return element(variant.Value)

    def check_array(variant: ua.Variant) -> tuple[bool, Any]:
        if not variant.is_array or variant.VariantType.value not in allowed:
            return False, None
        dimensions = variant.Dimensions
        if dimensions is not None and len(dimensions) != max(rank, 1):
            return False, None
        if variant.Value is None:
            return True, []
        if plain and empty is None:
            return True, variant.Value
        checked = [element(value) for value in variant.Value]
        return all(fits for fits, _ in checked), [value for _, value in checked]

    return check_scalar if rank < 0 else check_array


def _classes(aspace: AddressSpace, data_type: ua.NodeId) -> tuple[type, ...]:
    """Return the Python classes of a structure and of its subtypes: OPC UA takes a subtype wherever its base stands."""
    own = ua.extension_objects_by_datatype.get(data_type)
    if own is None:
        return ()
    found, waiting = [own], [data_type]
    while waiting:
        node = aspace.get(waiting.pop())
        below = [r.NodeId for r in node.references if r.ReferenceTypeId == _HAS_SUBTYPE and r.IsForward] if node else []
        waiting += below
        found += [ua.extension_objects_by_datatype[one] for one in below if one in ua.extension_objects_by_datatype]
    return tuple(found)


def output_variant(aspace: AddressSpace, data_type: ua.NodeId, rank: int, value: Any) -> ua.Variant:
    """Return a handler's output as a Variant of the declared type; a Variant is passed on as it is."""
    if isinstance(value, ua.Variant):
        return value
    if rank > 0 and not isinstance(value, np.ndarray):
        value = list(value)
    kind = ua.VariantType(_variant_type(aspace, data_type))
    return ua.Variant(value, kind, is_array=rank > 0)


def _variant_type(aspace: AddressSpace, data_type: ua.NodeId) -> int:
    allowed = builtin_types(aspace, data_type)
    if len(allowed) != 1:
        raise ValueError(f"{data_type.to_string()} is abstract: return a Variant for it")
    return next(iter(allowed))


def _is_member(enumeration: type[Enum], value: Any) -> bool:
    try:
        enumeration(value)
    except ValueError:
        return False
    return True


@functools.cache
def _nullable_fields(structure: type) -> tuple[tuple[str, Callable[[], Any] | None], ...]:
    """Return the fields that may arrive as null, with what makes an empty one; None: look into what is there."""
    hints = ua_binary.get_safe_type_hints(structure, {"ua": ua})
    found: list[tuple[str, Callable[[], Any] | None]] = []
    for entry in dataclasses.fields(structure):
        hint = ua_binary.strip_optional(hints.get(entry.name))
        inner = typing.get_args(hint)[0] if typing.get_origin(hint) is list else hint
        nested = isinstance(inner, type) and dataclasses.is_dataclass(inner) and inner is not ua.Variant
        if typing.get_origin(hint) is list:
            found.append((entry.name, list))
        elif isinstance(hint, type) and issubclass(hint, str):
            found.append((entry.name, str))
        elif isinstance(hint, type) and issubclass(hint, bytes):
            found.append((entry.name, bytes))
        if nested:
            found.append((entry.name, None))
    return tuple(found)


def _without_nulls(value: Any) -> Any:
    """Return a structure in which null texts, bytes and arrays are empty ones, also within the structures in it."""
    if isinstance(value, list):
        for one in value:
            _without_nulls(one)
    elif not isinstance(value, type) and dataclasses.is_dataclass(value) and not isinstance(value, ua.ExtensionObject):
        for name, make in _nullable_fields(type(value)):
            held = getattr(value, name)
            if make is None:
                _without_nulls(held)
            elif held is None:
                setattr(value, name, make())
    return value

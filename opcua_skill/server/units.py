"""Numbers with a unit and a range, as OPC 10000-8 has them, so that no client has to read it in our manual."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.server.address_space import Tree, standard

UNECE = "http://www.opcfoundation.org/UA/units/un/cefact"


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its UNECE code (empty: there is none for it), its symbol, and its name."""

    code: str
    symbol: str
    name: str

    def value(self) -> ua.EUInformation:
        """Return the unit as clients read it."""
        return ua.EUInformation(
            NamespaceUri=UNECE if self.code else "",
            UnitId=int.from_bytes(self.code.encode("ascii"), "big") if self.code else -1,  # pyright: ignore[reportArgumentType]
            DisplayName=ua.LocalizedText(self.symbol),
            Description=ua.LocalizedText(self.name),
        )


ONE = Unit("C62", "1", "one")
SECOND = Unit("SEC", "s", "second")
METRE = Unit("MTR", "m", "metre")
RADIAN = Unit("C81", "rad", "radian")
BYTE = Unit("AD", "B", "byte")
TURNING = (RADIAN, Unit("2A", "rad/s", "radian per second"), Unit("2B", "rad/s²", "radian per second squared"))
SLIDING = (METRE, Unit("MTS", "m/s", "metre per second"), Unit("MSK", "m/s²", "metre per second squared"))
JERKS = (Unit("", "rad/s³", "radian per second cubed"), Unit("M42", "m/s³", "metre per second cubed"))


def joint_units(slides: Sequence[bool]) -> tuple[Unit, Unit, Unit, Unit]:
    """Return the units of the positions, velocities, accelerations and jerks of an arm's joints."""
    turning, sliding = (*TURNING, JERKS[0]), (*SLIDING, JERKS[1])
    if not any(slides):
        return turning
    if all(slides):
        return sliding
    first, second, third, fourth = (
        Unit("", f"{a.symbol} or {b.symbol}", f"{a.name}, or {b.name} of a joint that slides")
        for a, b in zip(turning, sliding, strict=True)
    )
    return first, second, third, fourth


def measured(
    tree: Tree, path: str, parent: ua.NodeId, value: ua.Variant, unit: Unit, span: tuple[float, float], **options: Any
) -> ua.NodeId:
    """Add a variable with its unit and its range. Options are those of ``Tree.variable``."""
    node = tree.variable(path, parent, value, type_definition=ObjectIds.AnalogUnitRangeType, **options)
    place = options.get("node_id")
    for name, content, kind in (
        ("EURange", ua.Range(Low=float(span[0]), High=float(span[1])), ObjectIds.Range),  # pyright: ignore[reportArgumentType]
        ("EngineeringUnits", unit.value(), ObjectIds.EUInformation),
    ):
        member = tree.property(
            f"{path}/{name}",
            node,
            ua.Variant(content, ua.VariantType.ExtensionObject),
            data_type=standard(kind),
            name=ua.QualifiedName(name, 0),  # pyright: ignore[reportArgumentType]
            node_id=tree.type_id(f"{path}/{name}") if place is not None else None,
        )
        if place is not None:
            tree.make_mandatory(member)
    return node

"""Classes of the product's own structures, made from the server's definitions of them."""

from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.structures104 import make_enum, make_structure
from asyncua.ua.attribute_ids import AttributeIds

NAMES = (
    "SkillFailure",
    "DemonstrationDataType",
    "PoseDemonstrationDataType",
    "LearningOptionsDataType",
    "DemonstrationEditsDataType",
    "SkillSummaryDataType",
    "RecipeDataType",
    "JobReportDataType",
    "AuditEntryDataType",
)
"""What a client needs of docs/interface.md, 4; an enumeration comes before the structures with a field of it."""


async def load_structures(client: Client, types: int) -> None:
    """Make ``ua.DemonstrationDataType`` and its siblings exist; one request, or none where they are known already.

    ``types`` is the type namespace of the connected server. What an older server does not have stays absent.
    asyncua's own `load_data_type_definitions` walks through every data type there is: five hundred requests.
    """
    missing = [name for name in NAMES if not _known(name, types)]
    if not missing:
        return
    nodes = [_data_type(name, types) for name in missing]
    told = await client.uaclient.read_attributes(nodes, AttributeIds.DataTypeDefinition)
    for name, node, answer in zip(missing, nodes, told, strict=True):
        definition = answer.Value.Value if answer.Value is not None else None
        if isinstance(definition, ua.EnumDefinition):
            ua.register_enum(name, node, make_enum(name, definition, False)[name])
        elif isinstance(definition, ua.StructureDefinition):
            made = make_structure(node, name, definition)[name]
            ua.register_extension_object(name, definition.DefaultEncodingId, made, node)


def _data_type(name: str, types: int) -> ua.NodeId:
    return ua.NodeId(ua.String(name), ua.Int16(types))


def _known(name: str, types: int) -> bool:
    return getattr(getattr(ua, name, None), "data_type", None) == _data_type(name, types)

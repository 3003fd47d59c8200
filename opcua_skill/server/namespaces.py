"""`Server/Namespaces`: which version of each namespace is here, and that all of it is (OPC 10000-5, 6.3.13)."""

from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.server.address_space import INSTANCES, TYPES, Tree, standard, text
from opcua_skill.stack.address_space.capabilities import product_version

TYPES_VERSION, TYPES_PUBLISHED = "0.1.0", datetime(2026, 11, 30, tzinfo=UTC)


async def add_namespaces(tree: Tree) -> None:
    """Describe the namespaces that do not describe themselves: the server's own, our types and our instances."""
    uris = await tree.server.get_namespace_array()
    started = datetime.now(UTC)
    version = product_version()
    known = {TYPES: (TYPES_VERSION, TYPES_PUBLISHED), INSTANCES: (version, started), uris[1]: (version, started)}
    for uri, (told, published) in known.items():
        path = f"Server/Namespaces/{uri}"
        node = tree.object(
            path,
            standard(ObjectIds.Server_Namespaces),
            name=ua.QualifiedName(uri, uris.index(uri)),  # pyright: ignore[reportArgumentType]
            type_definition=standard(ObjectIds.NamespaceMetadataType),
            description="",
        )
        numbers = ua.Variant([], ua.VariantType.String, is_array=True)
        static = uri == TYPES
        values: dict[str, tuple[ua.Variant, dict[str, Any]]] = {
            "NamespaceUri": (text(uri), {}),
            "NamespaceVersion": (text(told), {}),
            "NamespacePublicationDate": (ua.Variant(published, ua.VariantType.DateTime), {}),
            "IsNamespaceSubset": (ua.Variant(False, ua.VariantType.Boolean), {}),
            "StaticNodeIdTypes": (
                ua.Variant([int(ua.IdType.String)] if static else [], ua.VariantType.Int32, is_array=True),
                {"data_type": standard(ObjectIds.IdType)},
            ),
            "StaticNumericNodeIdRange": (numbers, {"data_type": standard(ObjectIds.NumericRange)}),
            "StaticStringNodeIdPattern": (text(".*" if static else ""), {}),
        }
        for name, (value, options) in values.items():
            named: Any = ua.QualifiedName(name, 0)  # pyright: ignore[reportArgumentType]
            tree.property(f"{path}/{name}", node, value, name=named, **options)

"""Nodes and references added as asyncua adds them, in a third of its time: a start adds eight thousand nodes.

What comes out is the same, node by node; a test compares the two.
"""

from typing import Any

from asyncua import ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.address_space import AddressSpace, AttributeValue, NodeData, NodeManagementService
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.values import node_id, status

_ADMIN = User(role=UserRole.Admin)
_HAS_PROPERTY, _HAS_TYPE_DEFINITION = node_id(Ids.HasProperty), node_id(Ids.HasTypeDefinition)
_INSTANCES = (ua.NodeClass.Object, ua.NodeClass.Variable)
_NODE_CLASS, _BROWSE_NAME = ua.AttributeIds.NodeClass, ua.AttributeIds.BrowseName
_DISPLAY_NAME, _NODE_ID = ua.AttributeIds.DisplayName, ua.AttributeIds.NodeId
_ARRAY = "ArrayDimensions"
_ATTRIBUTES = tuple(
    (name, int(getattr(ua.NodeAttributesMask, name)), getattr(ua.AttributeIds, name), getattr(ua.VariantType, kind))
    for name, kind in (
        ("AccessLevel", "Byte"),
        (_ARRAY, "UInt32"),
        ("BrowseName", "QualifiedName"),
        ("ContainsNoLoops", "Boolean"),
        ("DataType", "NodeId"),
        ("Description", "LocalizedText"),
        ("DisplayName", "LocalizedText"),
        ("EventNotifier", "Byte"),
        ("Executable", "Boolean"),
        ("Historizing", "Boolean"),
        ("InverseName", "LocalizedText"),
        ("IsAbstract", "Boolean"),
        ("MinimumSamplingInterval", "Double"),
        ("NodeClass", "Int32"),
        ("NodeId", "NodeId"),
        ("Symmetric", "Boolean"),
        ("UserAccessLevel", "Byte"),
        ("UserExecutable", "Boolean"),
        ("ValueRank", "Int32"),
        ("WriteMask", "UInt32"),
        ("UserWriteMask", "UInt32"),
    )
)
FEW = 12
"""references up to which looking through all of them is quicker than keeping an index."""
_Index = dict[tuple[ua.NodeId, ua.NodeId], ua.ReferenceDescription]


class NodeService(NodeManagementService):
    """asyncua's node management. A node with many references has an index of them by type and target."""

    def __init__(self, aspace: AddressSpace) -> None:
        super().__init__(aspace)
        self._indexes: dict[ua.NodeId, tuple[NodeData, _Index]] = {}
        self._attributes_of: dict[int, tuple[tuple[str, ua.AttributeIds, ua.VariantType], ...]] = {}

    def _add_node(self, item: ua.AddNodesItem, user: User = _ADMIN, check: bool = True) -> ua.AddNodesResult:
        parent = self._aspace.get(item.ParentNodeId)
        wanted = item.RequestedNewNodeId
        known = not item.TypeDefinition.is_null() and item.TypeDefinition not in self._aspace
        if parent is None or known or user.role != UserRole.Admin or wanted.has_null_identifier():
            return super()._add_node(item, user, check)
        name = item.BrowseName.Name
        if wanted in self._aspace or any(
            one.BrowseName.Name == name and one.ReferenceTypeId == _HAS_PROPERTY for one in parent.references
        ):
            return super()._add_node(item, user, check)  # which says why it is refused
        node = NodeData(wanted)
        self._add_node_attributes(node, item, add_timestamps=check)
        self._aspace[wanted] = node
        self._add_ref_from_parent(node, item, parent)
        self._add_ref_to_parent(node, item, parent)
        if not item.TypeDefinition.is_null():
            self._add_type_definition(node, item)
        result = ua.AddNodesResult()
        result.AddedNodeId = wanted
        return result

    def _add_node_attributes(self, nodedata: NodeData, item: ua.AddNodesItem, add_timestamps: bool) -> None:
        attributes = nodedata.attributes
        attributes[_NODE_ID] = AttributeValue(_value(nodedata.nodeid, ua.VariantType.NodeId))
        attributes[_BROWSE_NAME] = AttributeValue(_value(item.BrowseName, ua.VariantType.QualifiedName))
        attributes[_NODE_CLASS] = AttributeValue(_value(item.NodeClass, ua.VariantType.Int32))
        given: Any = item.NodeAttributes
        specified = int(given.SpecifiedAttributes)
        for name, attribute, kind in self._specified(specified):
            value = getattr(given, name)
            if name == _ARRAY or value is None:
                attributes[attribute] = AttributeValue(ua.DataValue(ua.Variant(value, kind, is_array=name == _ARRAY)))
            else:
                attributes[attribute] = AttributeValue(_value(value, kind))
        self._add_node_attr(given, nodedata, "DataTypeDefinition", ua.VariantType.ExtensionObject)
        self._add_node_attr(given, nodedata, "Value", add_timestamps=add_timestamps)

    def _specified(self, mask: int) -> tuple[tuple[str, ua.AttributeIds, ua.VariantType], ...]:
        """Return the attributes that a mask names; there are a handful of masks."""
        if mask not in self._attributes_of:
            found = ((name, attribute, kind) for name, bit, attribute, kind in _ATTRIBUTES if mask & bit)
            self._attributes_of[mask] = tuple(found)
        return self._attributes_of[mask]

    def _add_reference_no_check(self, sourcedata: NodeData, addref: ua.AddReferencesItem) -> ua.StatusCode:
        described = ua.ReferenceDescription()
        described.ReferenceTypeId = addref.ReferenceTypeId
        described.IsForward = addref.IsForward
        described.NodeId = addref.TargetNodeId
        target = self._aspace.get(addref.TargetNodeId)
        kind = addref.TargetNodeClass
        if target is None:
            if kind != ua.NodeClass.Unspecified:
                described.NodeClass = kind
            return self._add_unique_reference(sourcedata, described)
        if kind == ua.NodeClass.Unspecified:
            kind = self._read(target, _NODE_CLASS)
        if kind is not None:
            described.NodeClass = kind
        described.BrowseName = self._read(target, _BROWSE_NAME) or described.BrowseName
        described.DisplayName = self._read(target, _DISPLAY_NAME) or described.DisplayName
        if described.NodeClass in _INSTANCES:
            for one in target.references:
                if one.IsForward and one.ReferenceTypeId == _HAS_TYPE_DEFINITION:
                    described.TypeDefinition = one.NodeId
                    break
        return self._add_unique_reference(sourcedata, described)

    def _read(self, node: NodeData, attribute: ua.AttributeIds) -> Any:
        value = self._aspace.read_attribute_value(node.nodeid, attribute).Value
        return value.Value if value is not None else None

    def _add_unique_reference(self, nodedata: NodeData, desc: ua.ReferenceDescription) -> ua.StatusCode:
        target, kind = desc.NodeId, desc.ReferenceTypeId
        if len(nodedata.references) <= FEW:
            same = next(
                (one for one in nodedata.references if one.NodeId == target and one.ReferenceTypeId == kind), None
            )
            index = None
        else:
            index = self._index(nodedata)
            same = index.get((kind, target))
        if same is None:
            nodedata.references.append(desc)
            if index is not None:
                index[kind, target] = desc
        elif same.IsForward != desc.IsForward:
            self.logger.error("Cannot add conflicting reference %s ", str(desc))
            return status(Codes.BadReferenceNotAllowed)
        return status()

    def _index(self, nodedata: NodeData) -> _Index:
        """Return the index of a node's references: all are added here, so what was deleted shows in their number."""
        kept = self._indexes.get(nodedata.nodeid)
        if kept is None or kept[0] is not nodedata or len(kept[1]) != len(nodedata.references):
            index: _Index = {}
            for one in nodedata.references:
                index.setdefault((one.ReferenceTypeId, one.NodeId), one)
            kept = self._indexes[nodedata.nodeid] = (nodedata, index)
        return kept[1]

    def _delete_node(self, item: ua.DeleteNodesItem, user: User = _ADMIN) -> ua.StatusCode:
        self._indexes.pop(item.NodeId, None)
        return super()._delete_node(item, user)


def _value(value: Any, kind: ua.VariantType) -> ua.DataValue:
    """Return a value of a known kind that is neither null nor an array, without looking at it again and again."""
    variant = ua.Variant.__new__(ua.Variant)
    variant.Value, variant.VariantType, variant.Dimensions, variant.is_array = value, kind, None, False
    made = ua.DataValue.__new__(ua.DataValue)
    made.Encoding, made.Value, made.StatusCode = 0, variant, ua.StatusCode()  # pyright: ignore[reportAttributeAccessIssue]
    made.SourceTimestamp = made.ServerTimestamp = made.SourcePicoseconds = made.ServerPicoseconds = None
    return made

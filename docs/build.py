"""Write the generated reference pages: configuration, methods, events, command line, and the types as a NodeSet."""

import asyncio
import inspect
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args
from xml.etree.ElementTree import Element

from asyncua import ua
from asyncua.common.xmlexporter import XmlExporter
from asyncua.ua.object_ids import ObjectIds
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from opcua_skill.commands.verbs import VERBS, imported
from opcua_skill.configuration.settings import Settings
from opcua_skill.security.access import Role
from opcua_skill.server.address_space import TYPES, standard
from opcua_skill.server.app import SkillServerApp
from opcua_skill.server.types import EVENT_TYPES
from opcua_skill.stack.server import SkillServer
from opcua_skill.stack.services.calls import Argument, MethodSpec
from sim.drivers.kinematic.arm import KinematicArm
from sim.robots import load

REFERENCE = Path(__file__).parent / "reference"
CONFIGURATION = REFERENCE / "configuration.md"
METHODS = REFERENCE / "methods.md"
EVENTS = REFERENCE / "events.md"
COMMAND_LINE = REFERENCE / "command-line.md"
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


async def methods_page() -> str:
    """Return the page about every method: who may call it, what it takes and what it answers."""
    lines = [
        "# Methods",
        "",
        "What each method takes and answers, and who may call it, as a server tells it by its nodes. What calls mean",
        "is in [the interface](../interface.md). Each role may also do all that the roles before it may: observer,",
        "operator, teacher, engineer, admin. `[]` is a flat array. Calls that the role is not enough for are refused:",
        "`BadUserAccessDenied`.",
    ]
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data=Path(folder), endpoint="opc.tcp://127.0.0.1:0")
        async with SkillServerApp(settings, lambda _station, _simulation: KinematicArm(load("panda"))) as app:
            service, space = app.server.iserver.method_service, app.server.iserver.aspace
            for place, spec in _methods(service, settings.workstations[0].name):
                lines += ["", f"## {place}", "", f"{_first_line(spec)} For: {_who(spec.roles)}.", ""]
                lines += _arguments(space, spec)
    return "\n".join(lines) + "\n"


def _methods(service: Any, workstation: str) -> Iterator[tuple[str, MethodSpec]]:
    """Yield where each of our methods stands, and what it is; those of one workstation stand for all."""
    seen: dict[str, MethodSpec] = {}
    for node_id in list(service._methods):
        if isinstance(node_id.Identifier, str) and "Type/" not in node_id.Identifier:
            place = node_id.Identifier.replace(f"/{workstation}/", "/<Workstation>/")
            seen[place] = service.spec(node_id)
    yield from sorted(seen.items())


def _first_line(spec: MethodSpec) -> str:
    return spec.description or (inspect.getdoc(spec.handler) or "").partition("\n")[0]


def _who(roles: frozenset[Role]) -> str:
    lowest = next((role for role in Role if role in roles), None)
    return "nobody" if lowest is None else lowest.value if len(roles) == 1 else f"{lowest.value} and above"


def _arguments(space: Any, spec: MethodSpec) -> list[str]:
    rows = [("in", one) for one in spec.inputs] + [("out", one) for one in spec.outputs]
    if not rows:
        return ["No arguments."]
    made = ["| | name | type | meaning |", "|---|---|---|---|"]
    return made + [f"| {way} | `{one.name}` | {_type(space, one)} | {one.description} |" for way, one in rows]


def _type(space: Any, argument: Argument) -> str:
    name = space.read_attribute_value(argument.data_type, ua.AttributeIds.BrowseName).Value.Value.Name
    return name + ("[]" if argument.rank >= 0 else "")


def events_page() -> str:
    """Return the page about every event type of ours and its fields."""
    lines = [
        "# Events",
        "",
        "Every type is a subtype of `BaseEventType`, in the namespace of our types; every event also reaches those",
        "who listen at the Server object. `Message` is said in the session's language. Calls are told by",
        "`AuditUpdateMethodEventType`.",
    ]
    for name, description, fields in EVENT_TYPES:
        lines += ["", f"## {name}", "", f"{description[:1].upper()}{description[1:]}.".replace("..", "."), ""]
        lines += ["| field | type |", "|---|---|"]
        lines += [f"| `{field}` | {kind.name} |" for field, kind in fields]
    return "\n".join(lines) + "\n"


def command_line_page() -> str:
    """Return the page about every verb of the command line and its options."""
    lines = [
        "# Command line",
        "",
        "`opcua-skill VERB …`; `-v` logs more, `-vv` all, `--version` says which. Exit status 0 is done, 1 refused or",
        "failed with one sentence on stderr, 2 wrong usage.",
    ]
    for name, verb in VERBS.items():
        lines += _command(imported(name, verb), name)
    return "\n".join(lines) + "\n"


def _command(command: Any, path: str) -> Iterator[str]:
    yield from ("", f"## opcua-skill {path}", "", " ".join((command.help or "").split()))
    if inner_verbs := getattr(command, "commands", None):
        for name, inner in inner_verbs.items():
            yield from _command(inner, f"{path} {name}")
        return
    rows = [row for one in command.params if (row := _option(one))]
    if rows:
        yield from ("", "| | meaning |", "|---|---|", *rows)


def _option(option: Any) -> str:
    if option.name in {"help", "install_completion", "show_completion"} or getattr(option, "hidden", False):
        return ""
    named = option.param_type_name == "option"
    names = " ".join((*option.opts, *option.secondary_opts)) if named else option.metavar or option.name.upper()
    meaning = " ".join((getattr(option, "help", None) or "").split())
    given = option.envvar if isinstance(option.envvar, str) else ", ".join(option.envvar or ())
    return f"| `{names}` | {meaning}{f' (or `{given}`)' if given else ''} |".replace("|  |", "| |")


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
    for page, text in (
        (CONFIGURATION, configuration_page()),
        (METHODS, asyncio.run(methods_page())),
        (EVENTS, events_page()),
        (COMMAND_LINE, command_line_page()),
    ):
        page.write_text(text, encoding="utf-8")
    NODE_SET.write_text(asyncio.run(node_set()), encoding="utf-8")


if __name__ == "__main__":
    main()

"""`users …`: who may sign in, written straight into the data folder by whoever owns it."""

import csv
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from library.names import doubles, same_user
from opcua_skill.commands.options.client import Json
from opcua_skill.commands.options.server import Config, Data, load_settings, with_library
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import counted, note, print_json, say, show_table, table, when
from opcua_skill.commands.trail import ACTOR, entry
from opcua_skill.security import hash_password, load_certificate
from opcua_skill.security.access import Role

if TYPE_CHECKING:
    from library.store import SkillLibrary

app = typer.Typer(no_args_is_help=True, help="Users and their roles, on the data folder of a server.")
Name = Annotated[str, typer.Argument(metavar="NAME", help="name of the user")]
FromStdin = Annotated[bool, typer.Option("--password-stdin", help="read the password from the first line of stdin")]


def new_password(name: str, from_stdin: bool) -> str:
    """Return a password's hash: from stdin, or typed twice at a terminal. Never an argument: others can read those."""
    if from_stdin:
        given = sys.stdin.readline().rstrip("\r\n")
    elif sys.stdin.isatty():
        given = typer.prompt(f"New password of {name}", hide_input=True, confirmation_prompt=True, err=True)
    else:
        raise Fault("no password: type it at a terminal, or give --password-stdin")
    try:
        return hash_password(given)
    except ValueError as error:
        raise Fault(f"{error} (argument password)") from None


@app.command()
def add(
    name: Name,
    role: Annotated[Role, typer.Option(help="what the user may do")],
    password_stdin: FromStdin = False,
    certificate: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, help="sign in with this certificate (DER or PEM) and no password"),
    ] = None,
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Add a user."""
    der = b""
    if certificate is not None:
        try:
            der = certificate_content(certificate)
        except ValueError:
            raise Fault(f"{certificate} is not a certificate in DER or PEM form") from None
    secret = "" if der and not password_stdin else new_password(name, password_stdin)
    with_library(
        load_settings(config, data=data),
        lambda library: library.add_user(
            name, role.value, secret, certificate=der, actor=ACTOR, entry=entry("AddUser", name, Role=role.value)
        ),
        may_make=True,
    )
    if as_json:
        print_json({"name": name, "role": role.value})
    else:
        say(f"{name} may sign in as {role.value}")


@app.command("import")
def import_users(
    file: Annotated[typer.FileText, typer.Argument(help="CSV with the columns name, role, password; - is stdin")],
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Add all users of a CSV file, or none of them."""
    try:
        added = checked_rows(file.read())
    except UnicodeDecodeError:
        raise Fault("the file is no text in UTF-8: save it as CSV in UTF-8") from None
    settings = load_settings(config, data=data)

    async def work(library: "SkillLibrary") -> None:
        there = {same_user(user.name): user.name for user in await library.users()}
        for name, _, _ in added:
            if (key := same_user(name)) in there:
                raise Fault(f"there is a user {there[key]} already: nobody was added")
            there[key] = name
        entries = [entry("AddUser", name, Role=role.value) for name, role, _ in added]
        await library.add_users([(name, role.value, secret) for name, role, secret in added], ACTOR, entries)

    with_library(settings, work, may_make=True)
    if as_json:
        print_json([{"name": name, "role": role.value} for name, role, _ in added])
    else:
        say(f"{counted(len(added), 'user')} may sign in: {', '.join(name for name, _, _ in added)}")


def checked_rows(text: str) -> list[tuple[str, Role, str]]:
    """Return name, role and password hash of every row, as spreadsheets save them."""
    lines = text.removeprefix("\ufeff").splitlines()
    told = 1 if lines and lines[0].lower().startswith("sep=") else 0
    head = lines[told] if len(lines) > told else ""
    delimiter = next((mark for mark in "\t;," if mark in head), ",")
    names = [name.strip().strip('"').lower() for name in head.split(delimiter)]
    missing = [name for name in ("name", "role", "password") if name not in names]
    if missing:
        raise Fault(f"line {told + 1}: there is no column {', '.join(missing)}: name, role and password are needed")
    found: dict[str, tuple[str, Role, str]] = {}
    for number, line in enumerate(lines[told + 1 :], told + 2):
        if not line.strip():
            continue
        try:
            cells = next(csv.reader([line], delimiter=delimiter, strict=True))
        except csv.Error:
            raise Fault(f"line {number}: a quote is opened and not closed") from None
        if len(cells) != len(names):
            raise Fault(f"line {number}: it has {counted(len(cells), 'cell')}, the first line {len(names)}")
        row = checked_row(number, dict(zip(names, cells, strict=True)))
        if row[0] in found:
            raise Fault(f"line {number}: {row[0]} stands in the file twice: nobody was added")
        found[row[0]] = row
    if not found:
        raise Fault("there are no users below the first line")
    return list(found.values())


def checked_row(number: int, row: dict[str, str]) -> tuple[str, Role, str]:
    """Return name, role and password hash of a CSV row; a fault names the line and what it lacks."""
    try:
        return row["name"].strip(), Role(row["role"].strip()), hash_password(row["password"])
    except ValueError as error:
        raise Fault(f"line {number}: {error}") from None


def certificate_content(file: Path) -> bytes:
    """Return the DER form of the certificate in a file; raises ValueError if there is none."""
    from cryptography.hazmat.primitives.serialization import Encoding

    return load_certificate(file.read_bytes()).public_bytes(Encoding.DER)


@app.command("list")
def list_users(data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """List users and their roles."""
    found = with_library(load_settings(config, data=data), lambda library: library.users())
    rows = [
        {
            "name": user.name,
            "role": user.role,
            "signs_in_with": "certificate" if user.certificate else "password",
            "created_at": user.created_at,
        }
        for user in found
    ]
    if as_json:
        print_json(rows)
        return
    columns = ("=name", "role", "signs in with", "since")
    for group in doubles(user.name for user in found):
        note(f"{', '.join(group)} differ in case or form of accents alone: remove one of them")
    show_table(table("", columns, [(*list(row.values())[:3], when(row["created_at"])) for row in rows]))


@app.command()
def remove(name: Name, data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """Remove a user; what the user did stays in the records."""
    with_library(load_settings(config, data=data), lambda library: library.remove_user(name, entry("RemoveUser", name)))
    if as_json:
        print_json({"name": name})
    else:
        say(f"{name} may no longer sign in")


@app.command("role")
def change_role(
    name: Name,
    role: Annotated[Role, typer.Argument(metavar="ROLE", help="what the user may do from now on")],
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Give a user another role; it counts for sessions that are open, too."""
    told = entry("SetRole", name, Role=role.value)
    with_library(load_settings(config, data=data), lambda library: library.set_role(name, role.value, told))
    if as_json:
        print_json({"name": name, "role": role.value})
    else:
        say(f"{name} is {role.value} from now on")


@app.command()
def password(
    name: Name, password_stdin: FromStdin = False, data: Data = None, config: Config = None, as_json: Json = False
) -> None:
    """Give a user a new password."""
    settings = load_settings(config, data=data)
    secret = new_password(name, password_stdin)
    told = entry("SetPassword", name)
    with_library(settings, lambda library: library.set_password_hash(name, secret, told))
    if as_json:
        print_json({"name": name})
    else:
        say(f"{name} has a new password")

"""`certificates …`: the server's own certificate, and which clients it lets in."""

from pathlib import Path
from typing import Annotated

import typer

from opcua_skill.commands.configuration import Config, Data, load_settings
from opcua_skill.commands.connection import Json
from opcua_skill.commands.faults import Fault
from opcua_skill.commands.output import print_json, say, screen, table, when
from opcua_skill.security import TrustList
from opcua_skill.settings import Settings

app = typer.Typer(no_args_is_help=True, help="Certificates, on the data folder of a server.")


def folder(settings: Settings) -> Path:
    """Return where a server keeps its key, its certificate and its trust list."""
    return settings.data / "certificates"


def trust_list(settings: Settings) -> TrustList:
    """Return the trust list of a data folder."""
    return TrustList(folder(settings))


@app.command()
def show(data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """Show the server's certificate; it is made if there is none yet."""
    from opcua_skill.security import ensure_server_certificate

    settings = load_settings(config, data=data)
    made = ensure_server_certificate(folder(settings), settings.application_uri, "opcua-skill")
    certificate = made.certificate()
    facts = {
        "file": made.certificate_file,
        "application_uri": made.application_uri,
        "thumbprint": made.thumbprint(),
        "valid_until": certificate.not_valid_after_utc,
    }
    if as_json:
        print_json(facts)
        return
    rows = [(key.replace("_", " "), when(value) if key == "valid_until" else value) for key, value in facts.items()]
    screen.print(table("the server's certificate", ("what", "value"), rows))


@app.command()
def trust(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="certificate file, or the start of a rejected one's thumbprint")
    ],
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Let a client's certificate in, from now on and without a restart."""
    listed = trust_list(load_settings(config, data=data))
    try:
        found = listed.trust(Path(file)) if Path(file).is_file() else listed.trust_rejected(file)
    except ValueError as error:
        raise Fault(f"{error} (argument FILE)") from None
    if as_json:
        print_json(found)
    else:
        say(f"{found.application_uri or found.subject} is trusted (thumbprint {found.thumbprint})")


@app.command("list")
def list_certificates(data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """List the clients that are let in, and those that were turned away."""
    found = trust_list(load_settings(config, data=data)).listed()
    if as_json:
        print_json(found)
        return
    rows = [
        (
            "trusted" if one.trusted else "rejected",
            one.application_uri or one.subject,
            one.thumbprint,
            when(one.valid_until),
        )
        for one in found
    ]
    screen.print(table("", ("", "application", "thumbprint", "valid until"), rows))

"""`certificates …`: the server's own certificate, and which clients it lets in."""

from pathlib import Path
from typing import Annotated

import typer

from opcua_skill.commands.options.client import Json
from opcua_skill.commands.options.server import Config, Data, load_settings
from opcua_skill.commands.terminal.errors import Fault
from opcua_skill.commands.terminal.output import note, print_json, say, show_table, table, when
from opcua_skill.commands.trail import entry, record
from opcua_skill.configuration.settings import Settings
from opcua_skill.security import ListedCertificate, TrustList
from opcua_skill.security.chains import CertificateFault
from opcua_skill.security.trust import certificate_in

app = typer.Typer(no_args_is_help=True, help="Certificates, on the data folder of a server.")

STILL_REFUSED = {
    CertificateFault.POLICY: "its key is too short (2048 to 4096 bits RSA are taken) or its signature too weak",
    CertificateFault.TIME: "it has expired or is not valid yet",
    CertificateFault.USE: "its key usage does not allow it to sign in as a client",
    CertificateFault.URI: "it names no application URI (subjectAltName), which OPC UA clients need",
    CertificateFault.ISSUER_TIME: "the authority's certificate has expired or is not valid yet",
    CertificateFault.ISSUER_USE: "the authority's certificate may not issue certificates",
    CertificateFault.UNKNOWN: "there is no valid revocation list of the authority in trusted/crl or issuers/crl",
    CertificateFault.ISSUER_UNKNOWN: "an authority above has no valid revocation list in trusted/crl or issuers/crl",
    CertificateFault.REVOKED: "its authority has revoked it",
    CertificateFault.ISSUER_REVOKED: "the authority that issued it has been revoked",
}


def folder(settings: Settings) -> Path:
    """Return where a server keeps its key, its certificate and its trust list; there has to be a data folder."""
    if not settings.data.is_dir():
        raise Fault(f"there is no data folder {settings.data}: check --data")
    return settings.data / "certificates"


def trust_list(settings: Settings, *, make: bool = False) -> TrustList:
    """Return the trust list of a data folder."""
    return TrustList(folder(settings), make=make)


@app.command()
def show(data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """Show the server's certificate, and what others may read that they should not; made if there is none yet."""
    from library.private_files import loose
    from opcua_skill.configuration.data_lock import database_file
    from opcua_skill.security import ensure_server_certificate

    settings = load_settings(config, data=data)
    try:
        made = ensure_server_certificate(folder(settings), settings.application_uri, "opcua-skill")
    except ValueError as error:
        raise Fault(str(error)) from None
    certificate = made.certificate()
    database = database_file(settings)
    too_open = loose(settings.data, *([database] if database else []))
    facts = {
        "file": made.certificate_file,
        "application_uri": made.application_uri,
        "thumbprint": made.thumbprint(),
        "valid_until": certificate.not_valid_after_utc,
    }
    if as_json:
        print_json({**facts, "open_to_others": {str(one.path): one.mode for one in too_open}})
        return
    rows = [(key.replace("_", " "), when(value) if key == "valid_until" else value) for key, value in facts.items()]
    show_table(table("the server's certificate", ("what", "value"), rows))
    for one in too_open:
        note(f"{one}: chmod go-rwx it, unless that is meant")


@app.command()
def trust(
    file: Annotated[
        str, typer.Argument(metavar="FILE", help="certificate file, or the start of a rejected one's thumbprint")
    ],
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Let a client's certificate in, from now on and without a restart; say for what it will still be refused."""
    settings = load_settings(config, data=data)
    try:
        given = certificate_in(Path(file)) if Path(file).is_file() else None
        listed = trust_list(settings, make=True)
        found = listed.trust_certificate(given) if given is not None else listed.trust_rejected(file)
    except ValueError as error:
        raise Fault(f"{error} (argument FILE)") from None
    record(settings, entry("TrustCertificate", found.thumbprint, Application=found.application_uri or found.subject))
    if as_json:
        print_json({**plain_fields(found), "refused_for": [one.value for one in found.refused_for]})
        return
    name = found.application_uri or found.subject
    if not found.refused_for:
        say(f"{name} is trusted (thumbprint {found.thumbprint})")
        return
    say(f"{name} is on the trust list (thumbprint {found.thumbprint}), but will still be refused:")
    for one in found.refused_for:
        say(f"  {STILL_REFUSED[one]} [{one.value}]")


@app.command()
def distrust(
    thumbprint: Annotated[str, typer.Argument(metavar="THUMBPRINT", help="(the start of) its thumbprint")],
    data: Data = None,
    config: Config = None,
    as_json: Json = False,
) -> None:
    """Turn a client that was let in away again; a running server ends its sessions within about a second."""
    settings = load_settings(config, data=data)
    try:
        gone = trust_list(settings).distrust(thumbprint)
    except ValueError as error:
        raise Fault(f"{error} (argument THUMBPRINT)") from None
    record(settings, entry("DistrustCertificate", gone.thumbprint, Application=gone.application_uri or gone.subject))
    if as_json:
        print_json({"thumbprint": gone.thumbprint})
    else:
        say(f"{gone.application_uri or gone.subject} is no longer trusted")


@app.command("list")
def list_certificates(data: Data = None, config: Config = None, as_json: Json = False) -> None:
    """List the clients that are let in, and those that were turned away."""
    found = trust_list(load_settings(config, data=data)).listed()
    if as_json:
        print_json([{**plain_fields(one), "refused_for": [why.value for why in one.refused_for]} for one in found])
        return
    rows = [
        (
            ("trusted, refused" if one.refused_for else "trusted") if one.trusted else "rejected",
            one.application_uri or one.subject,
            one.thumbprint,
            when(one.valid_until),
            "; ".join(STILL_REFUSED[why] for why in one.refused_for),
        )
        for one in found
    ]
    show_table(table("", ("", "application", "=thumbprint", "valid until", "refused because"), rows))


def plain_fields(one: ListedCertificate) -> dict[str, object]:
    """Return what a listed certificate says of itself, for a program."""
    names = ("file", "trusted", "thumbprint", "subject", "application_uri", "valid_until")
    return {name: getattr(one, name) for name in names}

"""Application certificates: self-signed, made at first start, keys readable by their owner alone."""

import ipaddress
import json
import logging
import os
import socket
import uuid
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from library.private_files import check_key, make_private

log = logging.getLogger(__name__)

KEY_BITS = 2048
VALID_FOR = timedelta(days=5 * 365)


@dataclass(frozen=True, slots=True)
class ApplicationCertificate:
    """A certificate (DER) and its private key (PEM) on disk, and the application URI the certificate is bound to.

    ``installation`` names the server's installation and no other; a client's is empty.
    """

    certificate_file: Path
    key_file: Path
    application_uri: str
    installation: str = ""

    def certificate(self) -> x509.Certificate:
        """Return the certificate."""
        return x509.load_der_x509_certificate(self.certificate_file.read_bytes())

    def thumbprint(self) -> str:
        """Return the SHA-1 thumbprint in hex, by which OPC UA tools name certificates."""
        return thumbprint(self.certificate())


class CertificateUnusable(ValueError):
    """Key and certificate in a folder that cannot be used as they are; they are never replaced unasked."""

    def __init__(self, file: Path, problem: str, remedy: str = "restore it from a backup") -> None:
        super().__init__(f"{file} {problem}: {remedy}, or move key and certificate away to have new ones made")
        self.file = file


def thumbprint(certificate: x509.Certificate) -> str:
    """Return the SHA-1 thumbprint in hex: a name, not a proof."""
    return certificate.fingerprint(hashes.SHA1()).hex()


def load_certificate(content: bytes) -> x509.Certificate:
    """Return a certificate from DER or PEM bytes; raises ValueError when it is neither."""
    if content.lstrip().startswith(b"-----BEGIN"):
        return x509.load_pem_x509_certificate(content)
    return x509.load_der_x509_certificate(content)


def ensure_server_certificate(
    folder: Path, application_uri: str, application_name: str, host_names: tuple[str, ...] = ()
) -> ApplicationCertificate:
    """Return the server's certificate in a folder; make key and certificate if there are none yet.

    Without an ``application_uri`` the certificate's is taken. A new certificate gets the one that was kept, or at
    the very first start one of this installation alone.
    """
    names = dict.fromkeys(("localhost", "127.0.0.1", socket.gethostname(), *host_names))
    make_private(folder)
    file = folder / "installation.json"
    kept = _kept(file)
    installation = kept.get("installation") or str(uuid.uuid4())
    if not application_uri and not (folder / "server.der").exists():
        application_uri = kept.get("application_uri") or f"urn:opcua-skill:server:{installation}"
    made = _ensure(folder, "server", application_uri, application_name, tuple(names), server=True)
    now = {"installation": installation, "application_uri": made.application_uri}
    if now != kept:
        _write(file, json.dumps(now, indent=2).encode(), mode=0o644)
    return replace(made, installation=installation)


def _kept(file: Path) -> dict[str, str]:
    """Return what an installation calls itself ever since its first start, nothing before that."""
    try:
        found = json.loads(file.read_bytes())
    except FileNotFoundError:
        return {}
    except ValueError:
        raise CertificateUnusable(file, "is damaged: it is no JSON") from None
    if not isinstance(found, dict):
        raise CertificateUnusable(file, "is damaged: it is no JSON object")
    return {str(key): str(value) for key, value in found.items()}


def ensure_client_certificate(
    folder: Path, application_uri: str, application_name: str = "opcua-skill client"
) -> ApplicationCertificate:
    """Return a client's certificate in a folder; make key and certificate if there are none yet.

    A server trusts it after ``opcua-skill certificates trust FILE`` with the certificate's file.
    """
    return _ensure(folder, "client", application_uri, application_name, (socket.gethostname(),), server=False)


def _ensure(
    folder: Path, stem: str, application_uri: str, application_name: str, names: tuple[str, ...], *, server: bool
) -> ApplicationCertificate:
    make_private(folder)
    found = ApplicationCertificate(folder / f"{stem}.der", folder / f"{stem}.pem", application_uri)
    if found.certificate_file.exists():
        return replace(found, application_uri=_check(found))
    if found.key_file.exists():
        check_key(found.key_file)
        key = _load_key(found.key_file)
        log.warning("%s is missing: it is made again for its key %s", found.certificate_file, found.key_file.name)
    else:
        key = _make_key(found.key_file)
    certificate = _self_signed(key, application_uri, application_name, names, server=server)
    _write(found.certificate_file, certificate.public_bytes(serialization.Encoding.DER), mode=0o644)
    return found


def _check(found: ApplicationCertificate) -> str:
    """Return the application URI of a certificate.

    Raises CertificateUnusable, or KeyIsOpen, unless key and certificate are there, whole, and made for each other.
    """
    if not found.key_file.exists():
        raise CertificateUnusable(found.key_file, f"is missing, the key of {found.certificate_file.name}")
    check_key(found.key_file)
    key = _load_key(found.key_file)
    try:
        certificate = found.certificate()
    except ValueError:
        raise CertificateUnusable(found.certificate_file, "is damaged: it is no certificate in DER form") from None
    if certificate.public_key() != key.public_key():
        raise CertificateUnusable(found.certificate_file, f"does not belong to the key {found.key_file.name}")
    try:
        alternative = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = alternative.get_values_for_type(x509.UniformResourceIdentifier)
    except x509.ExtensionNotFound:
        uris = []
    wanted = found.application_uri or next(iter(uris), "")
    if wanted not in uris:
        problem = f"is bound to {', '.join(uris) or 'no application URI'}, not to {wanted or 'any'}"
        raise CertificateUnusable(found.certificate_file, problem, "keep the URI")
    return wanted


def _load_key(file: Path) -> rsa.RSAPrivateKey:
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise CertificateUnusable(file, "is damaged: it is no private key in PEM form without a password") from None
    if not isinstance(key, rsa.RSAPrivateKey):
        raise CertificateUnusable(file, "is not an RSA key")
    return key


def _make_key(file: Path) -> rsa.RSAPrivateKey:
    key = rsa.generate_private_key(public_exponent=65537, key_size=KEY_BITS)
    pem = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    _write(file, pem, mode=0o600)
    return key


def _write(file: Path, content: bytes, *, mode: int) -> None:
    """Write a file whole or not at all, never readable by others for a moment."""
    scratch = file.with_name(f".{file.name}.{os.getpid()}")
    descriptor = os.open(scratch, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    scratch.replace(file)


def _self_signed(
    key: rsa.RSAPrivateKey, application_uri: str, application_name: str, names: tuple[str, ...], *, server: bool
) -> x509.Certificate:
    """Return an application instance certificate as OPC 10000-6, 6.2.2 asks for."""
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, application_name)])
    alternatives: list[x509.GeneralName] = [x509.UniformResourceIdentifier(application_uri)]
    for name in names:
        try:
            alternatives.append(x509.IPAddress(ipaddress.ip_address(name)))
        except ValueError:
            alternatives.append(x509.DNSName(name))
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH] + ([ExtendedKeyUsageOID.SERVER_AUTH] if server else [])
    now = datetime.now(UTC)
    identifier = x509.SubjectKeyIdentifier.from_public_key(key.public_key())
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))
        .not_valid_after(now + VALID_FOR)
        .add_extension(identifier, critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(identifier), critical=False)
        .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(
            x509.KeyUsage(
                digital_signature=True,
                content_commitment=True,
                key_encipherment=True,
                data_encipherment=True,
                key_agreement=False,
                key_cert_sign=True,
                crl_sign=False,
                encipher_only=False,
                decipher_only=False,
            ),
            critical=True,
        )
        .add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        .sign(key, hashes.SHA256())
    )

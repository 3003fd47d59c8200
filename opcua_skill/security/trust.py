"""The trust list: a folder of client certificates that are let in, and one of those that were turned away."""

import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import serialization

from opcua_skill.security.certificates import load_certificate, thumbprint

MAX_REJECTED = 100


@dataclass(frozen=True, slots=True)
class ListedCertificate:
    """One certificate of the trust list: where it lies and what it says of itself."""

    file: Path
    trusted: bool
    thumbprint: str
    subject: str
    application_uri: str
    valid_until: datetime


class TrustList:
    """Client certificates in ``trusted/`` are let in; those turned away are kept in ``rejected/`` for a look.

    The folders are read at every sign-in, so trusting a certificate takes effect without a restart. At most
    MAX_REJECTED rejected certificates are kept, the newest ones.
    """

    def __init__(self, folder: Path) -> None:
        self.trusted_folder = folder / "trusted"
        self.rejected_folder = folder / "rejected"
        for place in (folder, self.trusted_folder, self.rejected_folder):
            place.mkdir(parents=True, exist_ok=True, mode=0o700)

    def is_trusted(self, certificate: x509.Certificate) -> bool:
        """Return whether exactly this certificate lies in ``trusted/``, whatever its file is called."""
        named = self.trusted_folder / _file_name(certificate)
        content = certificate.public_bytes(serialization.Encoding.DER)
        if named.exists() and named.read_bytes() == content:
            return True
        return any(found == certificate for found, _ in _certificates(self.trusted_folder))

    def trust(self, file: Path) -> ListedCertificate:
        """Let the certificate in a DER or PEM file in from now on; raises ValueError if the file is no certificate."""
        try:
            certificate = load_certificate(file.read_bytes())
        except ValueError:
            raise ValueError(f"{file} is not a certificate in DER or PEM form") from None
        return self.trust_certificate(certificate)

    def trust_certificate(self, certificate: x509.Certificate) -> ListedCertificate:
        """Let this certificate in from now on."""
        name = _file_name(certificate)
        _replace(self.trusted_folder / name, certificate.public_bytes(serialization.Encoding.DER))
        (self.rejected_folder / name).unlink(missing_ok=True)
        return _listed(self.trusted_folder / name, certificate, trusted=True)

    def trust_rejected(self, start_of_thumbprint: str) -> ListedCertificate:
        """Let a certificate that was turned away in, named by (the start of) its thumbprint."""
        wanted = start_of_thumbprint.lower().replace(" ", "").replace(":", "")
        found = [c for c, _ in _certificates(self.rejected_folder) if wanted and thumbprint(c).startswith(wanted)]
        if len(found) != 1:
            raise ValueError(f"{len(found)} rejected certificates have a thumbprint that starts with {wanted!r}")
        return self.trust_certificate(found[0])

    def distrust(self, start_of_thumbprint: str) -> None:
        """Turn a certificate that was let in away from now on."""
        wanted = start_of_thumbprint.lower()
        found = [(c, f) for c, f in _certificates(self.trusted_folder) if wanted and thumbprint(c).startswith(wanted)]
        if len(found) != 1:
            raise ValueError(f"{len(found)} trusted certificates have a thumbprint that starts with {wanted!r}")
        found[0][1].unlink()

    def reject(self, certificate: x509.Certificate) -> None:
        """Keep a certificate that was turned away, and forget the oldest when there are too many."""
        _replace(self.rejected_folder / _file_name(certificate), certificate.public_bytes(serialization.Encoding.DER))
        kept = sorted(self.rejected_folder.glob("*.der"), key=lambda file: file.stat().st_mtime)
        for file in kept[:-MAX_REJECTED]:
            file.unlink(missing_ok=True)

    def listed(self) -> list[ListedCertificate]:
        """Return all certificates, the trusted ones first."""
        return [
            _listed(file, certificate, trusted=folder is self.trusted_folder)
            for folder in (self.trusted_folder, self.rejected_folder)
            for certificate, file in _certificates(folder)
        ]


def application_uri(certificate: x509.Certificate) -> str:
    """Return the application URI a certificate is bound to, empty if it names none."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")


def _file_name(certificate: x509.Certificate) -> str:
    return f"{thumbprint(certificate)}.der"


def _listed(file: Path, certificate: x509.Certificate, *, trusted: bool) -> ListedCertificate:
    return ListedCertificate(
        file=file,
        trusted=trusted,
        thumbprint=thumbprint(certificate),
        subject=certificate.subject.rfc4514_string(),
        application_uri=application_uri(certificate),
        valid_until=certificate.not_valid_after_utc.astimezone(UTC),
    )


def _certificates(folder: Path) -> list[tuple[x509.Certificate, Path]]:
    found = []
    for file in sorted(folder.iterdir()):
        if file.suffix.lower() not in {".der", ".pem", ".crt", ".cer"} or file.name.startswith("."):
            continue
        try:
            found.append((load_certificate(file.read_bytes()), file))
        except ValueError:
            continue  # a file somebody put there by mistake must not lock everybody out
    return found


def _replace(file: Path, content: bytes) -> None:
    scratch = file.with_name(f".{file.name}.{os.getpid()}")
    scratch.write_bytes(content)
    scratch.replace(file)

"""The trust list: certificates that are let in, authorities and what they took back, and who was turned away."""

import contextlib
import logging
import os
import shlex
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import serialization

from library.private_files import make_private
from opcua_skill.security.certificates import load_certificate, thumbprint
from opcua_skill.security.chains import LONGEST_CHAIN, CertificateFault, Known, fault, remaining_faults

log = logging.getLogger(__name__)
MAX_REJECTED = 100
SHOWN = 12
"""digits of a thumbprint that tell certificates apart."""


@dataclass(frozen=True, slots=True)
class ListedCertificate:
    """One certificate of the trust list: where it lies and what it says of itself."""

    file: Path
    trusted: bool
    thumbprint: str
    subject: str
    application_uri: str
    valid_until: datetime
    refused_for: tuple[CertificateFault, ...] = ()
    """Why it is refused although it is trusted (of an authority: its clients); empty if it is let in."""


class TrustList:
    """Which clients are let in: a folder that an administrator fills, laid out as other OPC UA servers have it.

    ``trusted/certs`` holds clients and authorities that are trusted, ``issuers/certs`` authorities that merely complete
    a chain, ``trusted/crl`` and ``issuers/crl`` the authorities' revocation lists, ``rejected/`` the clients turned
    away, the newest MAX_REJECTED of them. The folders are read at every sign-in, so a change takes effect without a
    restart. Certificates that lie in ``trusted/`` itself count as well. Folders are made unless ``make`` is False.
    """

    def __init__(self, folder: Path, *, make: bool = True) -> None:
        self.folder = folder
        self.trusted_folder = folder / "trusted" / "certs"
        self.issuers_folder = folder / "issuers" / "certs"
        self.rejected_folder = folder / "rejected"
        self._lists = (folder / "trusted" / "crl", folder / "issuers" / "crl")
        self._trusted = (self.trusted_folder, folder / "trusted")
        if make:
            for place in (folder, *self._trusted, self.issuers_folder, self.rejected_folder, *self._lists):
                make_private(place)

    def fault(self, certificate: x509.Certificate, sent_along: bytes = b"") -> CertificateFault | None:
        """Return why a client's certificate is refused, None for one that is good; see chains.fault.

        ``sent_along`` are the certificates (DER, one after the other) of authorities that the client itself names.
        """
        return fault(certificate, self._known(), datetime.now(UTC), _split(sent_along))

    def stamp(self) -> tuple[tuple[str, int, int], ...]:
        """Return what changes whenever a file of the folders is added, removed or replaced."""
        found = []
        for folder in (*self._trusted, self.issuers_folder, *self._lists):
            for entry in os.scandir(folder) if folder.is_dir() else ():
                with contextlib.suppress(FileNotFoundError):
                    told = entry.stat()
                    found.append((entry.path, told.st_mtime_ns, told.st_size))
        return tuple(sorted(found))

    def _known(self) -> Known:
        return Known(
            trusted=[one for folder in self._trusted for one, _ in _certificates(folder)],
            issuers=[one for one, _ in _certificates(self.issuers_folder)],
            lists=[one for folder in self._lists for one in _revocation_lists(folder)],
        )

    def is_trusted(self, certificate: x509.Certificate) -> bool:
        """Return whether exactly this certificate is trusted by itself, whatever its file is called."""
        return any(found == certificate for folder in self._trusted for found, _ in _certificates(folder))

    def trust(self, file: Path) -> ListedCertificate:
        """Let the certificate in a DER or PEM file in from now on; raises ValueError if the file is no certificate."""
        return self.trust_certificate(certificate_in(file))

    def trust_certificate(self, certificate: x509.Certificate) -> ListedCertificate:
        """Let this certificate in from now on."""
        name = _file_name(certificate)
        _replace(self.trusted_folder / name, certificate.public_bytes(serialization.Encoding.DER))
        (self.rejected_folder / name).unlink(missing_ok=True)
        return self._listed(self.trusted_folder / name, certificate, trusted=True)

    def trust_rejected(self, start_of_thumbprint: str) -> ListedCertificate:
        """Let a certificate that was turned away in, named by (the start of) its thumbprint."""
        wanted = start_of_thumbprint.lower().replace(" ", "").replace(":", "")
        found = [c for c, _ in _certificates(self.rejected_folder) if wanted and thumbprint(c).startswith(wanted)]
        if len(found) != 1:
            raise ValueError(f"{len(found)} rejected certificates have a thumbprint that starts with {wanted!r}")
        return self.trust_certificate(found[0])

    def distrust(self, start_of_thumbprint: str) -> ListedCertificate:
        """Turn a certificate that was let in away from now on, named by (the start of) its thumbprint."""
        wanted = start_of_thumbprint.lower().replace(" ", "").replace(":", "")
        known = [found for folder in self._trusted for found in _certificates(folder)]
        found = [(c, f) for c, f in known if wanted and thumbprint(c).startswith(wanted)]
        if len({thumbprint(c) for c, _ in found}) != 1:
            raise ValueError(f"{len(found)} trusted certificates have a thumbprint that starts with {wanted!r}")
        gone, file = found[0]
        listed = self._listed(file, gone, trusted=False)
        for _, same in [(c, f) for c, f in known if c == gone]:
            same.unlink()
        return listed

    def words_to_trust(self, certificate: x509.Certificate) -> str:
        """Return the command that lets in a certificate that was turned away, to be run as it stands on the server."""
        data = shlex.quote(str(self.folder.parent.absolute()))
        return f"opcua-skill certificates trust {thumbprint(certificate)[:SHOWN]} --data {data}"

    def reject(self, certificate: x509.Certificate) -> None:
        """Keep a certificate that was turned away, and forget the oldest when there are too many."""
        _replace(self.rejected_folder / _file_name(certificate), certificate.public_bytes(serialization.Encoding.DER))
        kept = sorted(self.rejected_folder.glob("*.der"), key=lambda file: file.stat().st_mtime)
        for file in kept[:-MAX_REJECTED]:
            file.unlink(missing_ok=True)

    def listed(self) -> list[ListedCertificate]:
        """Return all certificates, the trusted ones first."""
        return [
            self._listed(file, certificate, trusted=folder in self._trusted)
            for folder in (*self._trusted, self.rejected_folder)
            for certificate, file in _certificates(folder)
        ]

    def _listed(self, file: Path, certificate: x509.Certificate, *, trusted: bool) -> ListedCertificate:
        return ListedCertificate(
            file=file,
            trusted=trusted,
            thumbprint=thumbprint(certificate),
            subject=certificate.subject.rfc4514_string(),
            application_uri=application_uri(certificate),
            valid_until=certificate.not_valid_after_utc.astimezone(UTC),
            refused_for=tuple(remaining_faults(certificate, self._known(), datetime.now(UTC))) if trusted else (),
        )


def certificate_in(file: Path) -> x509.Certificate:
    """Return the certificate in a DER or PEM file; raises ValueError if it is none."""
    try:
        return load_certificate(file.read_bytes())
    except ValueError:
        raise ValueError(f"{file} is not a certificate in DER or PEM form") from None


def application_uri(certificate: x509.Certificate) -> str:
    """Return the application URI a certificate is bound to, empty if it names none."""
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return ""
    return next(iter(names.get_values_for_type(x509.UniformResourceIdentifier)), "")


def _file_name(certificate: x509.Certificate) -> str:
    return f"{thumbprint(certificate)}.der"


def _certificates(folder: Path) -> list[tuple[x509.Certificate, Path]]:
    found = []
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        if file.suffix.lower() not in {".der", ".pem", ".crt", ".cer"} or file.name.startswith("."):
            continue
        try:
            found.append((load_certificate(file.read_bytes()), file))
        except ValueError:
            continue  # a file somebody put there by mistake must not lock everybody out
    return found


def _revocation_lists(folder: Path) -> list[x509.CertificateRevocationList]:
    found = []
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        if file.suffix.lower() not in {".crl", ".der", ".pem"} or file.name.startswith("."):
            continue
        content = file.read_bytes()
        text = content.lstrip().startswith(b"-----BEGIN")
        try:
            found.append((x509.load_pem_x509_crl if text else x509.load_der_x509_crl)(content))
        except ValueError:
            log.warning("%s is not a revocation list: it is passed over", file)
    return found


def _split(certificates: bytes) -> list[x509.Certificate]:
    """Return certificates that stand one after the other, as far as they can be read."""
    found = []
    while len(certificates) > 4 and len(found) < LONGEST_CHAIN:
        size = 4 + int.from_bytes(certificates[2:4], "big")  # certificates are longer than 255 and shorter than 65 kB
        try:
            found.append(x509.load_der_x509_certificate(certificates[:size]))
        except ValueError:
            break
        certificates = certificates[size:]
    return found


def _replace(file: Path, content: bytes) -> None:
    scratch = file.with_name(f".{file.name}.{os.getpid()}")
    scratch.write_bytes(content)
    scratch.replace(file)

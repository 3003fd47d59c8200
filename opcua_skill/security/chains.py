"""Whether a certificate may be relied on (OPC 10000-4, 6.1.3): its dates, its use, who issued it, who took it back."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum
from typing import TypeVar

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID

KEY_BITS_ALLOWED = range(2048, 4097)
LONGEST_CHAIN = 8
_WEAK = (hashes.MD5, hashes.SHA1)
Extension = TypeVar("Extension", bound=x509.ExtensionType)


class CertificateFault(StrEnum):
    """Why a certificate is refused; the values are the names of the OPC UA status codes."""

    POLICY = "BadCertificatePolicyCheckFailed"
    TIME = "BadCertificateTimeInvalid"
    ISSUER_TIME = "BadCertificateIssuerTimeInvalid"
    USE = "BadCertificateUseNotAllowed"
    ISSUER_USE = "BadCertificateIssuerUseNotAllowed"
    UNTRUSTED = "BadCertificateUntrusted"
    INCOMPLETE = "BadCertificateChainIncomplete"
    UNKNOWN = "BadCertificateRevocationUnknown"
    ISSUER_UNKNOWN = "BadCertificateIssuerRevocationUnknown"
    REVOKED = "BadCertificateRevoked"
    URI = "BadCertificateUriInvalid"
    ISSUER_REVOKED = "BadCertificateIssuerRevoked"


@dataclass(frozen=True, slots=True)
class Known:
    """What an administrator has put into the folders: certificates that are trusted, issuers that merely complete a
    chain, and the revocation lists of both."""

    trusted: Sequence[x509.Certificate]
    issuers: Sequence[x509.Certificate]
    lists: Sequence[x509.CertificateRevocationList]


def fault(
    certificate: x509.Certificate, known: Known, now: datetime, sent_along: Sequence[x509.Certificate] = ()
) -> CertificateFault | None:
    """Return why a client's certificate is refused, None for one that is good.

    It is good if it, or an authority above it, is trusted; every authority on the way needs a revocation list that is
    not out of date. A certificate that is trusted itself needs no authority, but one that is known can revoke it.
    """
    if found := _own_fault(certificate, now):
        return found
    chain = _chain(certificate, [*known.trusted, *known.issuers, *sent_along])
    itself = certificate in known.trusted
    if not itself and not any(one in known.trusted for one in chain):
        whole = _issued_by(chain[-1], chain[-1])
        return CertificateFault.UNTRUSTED if whole else CertificateFault.INCOMPLETE
    for place, issuer in enumerate(chain[1:]):
        if found := _issuer_fault(issuer, place, now):
            return found
    for place, (issued, issuer) in enumerate(itertools.pairwise(chain)):
        revoked = _is_revoked(issued, issuer, known.lists, now)
        if revoked:
            return CertificateFault.ISSUER_REVOKED if place else CertificateFault.REVOKED
        if revoked is None and not itself:
            return CertificateFault.ISSUER_UNKNOWN if place else CertificateFault.UNKNOWN
    return None


def remaining_faults(certificate: x509.Certificate, known: Known, now: datetime) -> list[CertificateFault]:
    """Return all for which a certificate that is trusted is refused nevertheless; of an authority, its clients."""
    if is_authority(certificate):
        found = _issuer_fault(certificate, 0, now)
        lists = any(
            one.issuer == certificate.subject and (one.next_update_utc is None or now <= one.next_update_utc)
            for one in known.lists
        )
        return [*([found] if found else []), *([] if lists else [CertificateFault.UNKNOWN])]
    found = [one for one in (_weakness(certificate), _outside_its_time(certificate, now), _misuse(certificate)) if one]
    names = _extension(certificate, x509.SubjectAlternativeName)
    if names is None or not names.get_values_for_type(x509.UniformResourceIdentifier):
        found.append(CertificateFault.URI)
    if not found and (above := fault(certificate, known, now)):
        found.append(above)
    return found


def is_authority(certificate: x509.Certificate) -> bool:
    """Return whether a certificate is that of an authority, not of an application."""
    constraints = _extension(certificate, x509.BasicConstraints)
    return constraints is not None and constraints.ca


def _own_fault(certificate: x509.Certificate, now: datetime) -> CertificateFault | None:
    """Return what is wrong with an application's certificate as such."""
    return _weakness(certificate) or _outside_its_time(certificate, now) or _misuse(certificate)


def _weakness(certificate: x509.Certificate) -> CertificateFault | None:
    key = certificate.public_key()
    strong = isinstance(key, rsa.RSAPublicKey) and key.key_size in KEY_BITS_ALLOWED
    weak = not strong or isinstance(certificate.signature_hash_algorithm, _WEAK)
    return CertificateFault.POLICY if weak else None


def _outside_its_time(certificate: x509.Certificate, now: datetime) -> CertificateFault | None:
    return None if _valid_at(certificate, now) else CertificateFault.TIME


def _misuse(certificate: x509.Certificate) -> CertificateFault | None:
    usage, purposes = _extension(certificate, x509.KeyUsage), _extension(certificate, x509.ExtendedKeyUsage)
    signs = usage is None or (usage.digital_signature and (usage.key_encipherment or usage.data_encipherment))
    if not signs or (purposes is not None and ExtendedKeyUsageOID.CLIENT_AUTH not in purposes):
        return CertificateFault.USE
    return None


def _issuer_fault(issuer: x509.Certificate, below: int, now: datetime) -> CertificateFault | None:
    """Return what is wrong with an authority that has ``below`` other authorities under it in the chain."""
    if not _valid_at(issuer, now):
        return CertificateFault.ISSUER_TIME
    constraints, usage = _extension(issuer, x509.BasicConstraints), _extension(issuer, x509.KeyUsage)
    may = constraints is not None and constraints.ca and (usage is None or usage.key_cert_sign)
    deep = constraints is not None and constraints.path_length is not None and below > constraints.path_length
    if not may or deep or isinstance(issuer.signature_hash_algorithm, _WEAK):
        return CertificateFault.ISSUER_USE
    return None


def _chain(certificate: x509.Certificate, candidates: Sequence[x509.Certificate]) -> list[x509.Certificate]:
    """Return the certificate and its issuers as far up as they are known; a circle is not walked twice."""
    chain = [certificate]
    while len(chain) < LONGEST_CHAIN and not _issued_by(chain[-1], chain[-1]):
        above = next((one for one in candidates if one not in chain and _issued_by(chain[-1], one)), None)
        if above is None:
            break
        chain.append(above)
    return chain


def _issued_by(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    if certificate.issuer != issuer.subject:
        return False
    try:
        certificate.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature):
        return False
    return True


def _is_revoked(
    certificate: x509.Certificate,
    issuer: x509.Certificate,
    lists: Sequence[x509.CertificateRevocationList],
    now: datetime,
) -> bool | None:
    """Return whether its issuer has taken a certificate back, None if no list of today says so or otherwise."""
    known = None
    for one in lists:
        if one.issuer != issuer.subject or not _signed_by(one, issuer):
            continue
        if one.get_revoked_certificate_by_serial_number(certificate.serial_number) is not None:
            return True
        if one.next_update_utc is None or now <= one.next_update_utc:
            known = False
    return known


def _signed_by(revoked: x509.CertificateRevocationList, issuer: x509.Certificate) -> bool:
    key = issuer.public_key()
    return isinstance(key, rsa.RSAPublicKey) and revoked.is_signature_valid(key)


def _valid_at(certificate: x509.Certificate, now: datetime) -> bool:
    return certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc


def _extension(certificate: x509.Certificate, kind: type[Extension]) -> Extension | None:
    try:
        return certificate.extensions.get_extension_for_class(kind).value
    except x509.ExtensionNotFound:
        return None

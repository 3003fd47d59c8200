"""Certificate authorities for tests: they issue certificates and take them back. Keys are made once for a test run."""

import functools
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

NOW = datetime.now(UTC)
DAY = timedelta(days=1)
DER = serialization.Encoding.DER
USAGES = [
    "digital_signature",
    "content_commitment",
    "key_encipherment",
    "data_encipherment",
    "key_agreement",
    "key_cert_sign",
    "crl_sign",
    "encipher_only",
    "decipher_only",
]


def key(name: str, bits: int = 2048) -> rsa.RSAPrivateKey:
    return _key(name, bits)


@functools.cache
def _key(name: str, bits: int) -> rsa.RSAPrivateKey:
    return rsa.generate_private_key(public_exponent=65537, key_size=bits)


def named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


@dataclass
class Authority:
    """An authority; ``above`` has issued it, or it has issued itself."""

    name: str
    above: "Authority | None" = None
    depth: int | None = None
    is_authority: bool = True
    valid: tuple[timedelta, timedelta] = (-DAY, 365 * DAY)
    revoked: list[x509.Certificate] = field(default_factory=list)

    @functools.cached_property
    def certificate(self) -> x509.Certificate:
        usage = ("key_cert_sign", "crl_sign", "digital_signature")
        above = self.above or self
        builder = _begun(self.name, above.name, key(self.name), self.valid)
        builder = builder.add_extension(x509.BasicConstraints(self.is_authority, self.depth), critical=True)
        return builder.add_extension(_usage(usage), critical=True).sign(key(above.name), hashes.SHA256())

    def issue(
        self,
        name: str,
        *,
        uri: str = "urn:opcua-skill:test-client",
        valid: tuple[timedelta, timedelta] = (-DAY, 30 * DAY),
        usage: tuple[str, ...] = ("digital_signature", "key_encipherment", "data_encipherment"),
        purposes: tuple[x509.ObjectIdentifier, ...] = (ExtendedKeyUsageOID.CLIENT_AUTH,),
        bits: int = 2048,
    ) -> x509.Certificate:
        """Return an application's certificate."""
        builder = _begun(name, self.name, key(name, bits), valid)
        alternative = x509.SubjectAlternativeName([x509.UniformResourceIdentifier(uri)])
        builder = builder.add_extension(alternative, critical=False).add_extension(_usage(usage), critical=True)
        builder = builder.add_extension(x509.ExtendedKeyUsage(purposes), critical=False)
        return builder.sign(key(self.name), hashes.SHA256())

    def revocations(self, *, until: timedelta = DAY) -> x509.CertificateRevocationList:
        """Return the list of what this authority has taken back."""
        builder = x509.CertificateRevocationListBuilder().issuer_name(named(self.name))
        builder = builder.last_update(NOW - 2 * DAY).next_update(NOW + until)
        for one in self.revoked:
            taken_back = x509.RevokedCertificateBuilder().serial_number(one.serial_number).revocation_date(NOW - DAY)
            builder = builder.add_revoked_certificate(taken_back.build())
        return builder.sign(key(self.name), hashes.SHA256())


def _begun(name: str, issuer: str, own: rsa.RSAPrivateKey, valid: tuple[timedelta, timedelta]):
    return (
        x509.CertificateBuilder()
        .subject_name(named(name))
        .issuer_name(named(issuer))
        .public_key(own.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(NOW + valid[0])
        .not_valid_after(NOW + valid[1])
    )


def _usage(allowed: tuple[str, ...]) -> x509.KeyUsage:
    return x509.KeyUsage(**{name: name in allowed for name in USAGES})


def write(folder: Path, certificate: x509.Certificate, name: str) -> Path:
    """Write a certificate and its key as a client's; return the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "client.der").write_bytes(certificate.public_bytes(DER))
    (folder / "client.pem").touch(mode=0o600)
    (folder / "client.pem").write_bytes(
        key(name).private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
    )
    return folder

"""The page over TLS: a certificate is needed for any address but this machine's own, and is really used."""

import os
import ssl
import subprocess
import sys
import urllib.error
import urllib.request
from datetime import UTC, datetime, timedelta
from ipaddress import IPv4Address
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tests.conftest import free_port

COMMAND = [sys.executable, "-m", "opcua_skill.cli", "panel", "--server", "opc.tcp://127.0.0.1:1"]


def environment() -> dict[str, str]:
    """Return an environment in which nothing knows of a test."""
    return {key: value for key, value in os.environ.items() if not key.startswith(("PYTEST", "NICEGUI", "OPCUA_SKILL"))}


def certificate(folder: Path) -> tuple[Path, Path]:
    """Make a certificate for this machine's own address, as a plant's administrator would."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "panel of a test")])
    now = datetime.now(UTC)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number(), now, now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(IPv4Address("127.0.0.1"))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    files = folder / "panel.pem", folder / "panel.key"
    files[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    files[1].write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return files


def test_another_address_without_tls_is_refused_in_a_sentence() -> None:
    ended = subprocess.run(
        [*COMMAND, "--host", "0.0.0.0"], capture_output=True, text=True, timeout=60, check=False, env=environment()
    )
    assert ended.returncode == 1
    assert "can be reached from other machines: give --certificate and --key (TLS) as well" in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.slow
def test_with_a_certificate_the_page_is_served_over_tls_and_no_other_way(tmp_path: Path) -> None:
    pem, key = certificate(tmp_path)
    port = free_port()
    command = [*COMMAND, "--host", "0.0.0.0", "--port", str(port), "--certificate", str(pem), "--key", str(key)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment())
    assert process.stdout is not None
    try:
        assert process.stdout.readline().startswith("panel on https://")
        trusted = ssl.create_default_context(cafile=str(pem))
        with urllib.request.urlopen(f"https://127.0.0.1:{port}/sign-in", context=trusted, timeout=30) as answer:
            assert answer.status == 200
            cookie = answer.headers["set-cookie"]
        assert "secure" in cookie.lower() and "samesite=strict" in cookie.lower()
        with pytest.raises((urllib.error.URLError, ConnectionError)):
            urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=10)
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()

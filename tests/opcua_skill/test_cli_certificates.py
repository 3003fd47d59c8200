"""What `certificates` says: for what a client will still be refused, and which words to run, as they stand."""

import json
import shlex
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import NameOID

from opcua_skill.commands.options.server import data_options, load_settings
from opcua_skill.commands.verbs import status_of

NOW, YEAR = datetime.now(UTC), timedelta(days=365)


def certificate(
    folder: Path, *, bits: int = 2048, begins: datetime = NOW - YEAR, ends: datetime = NOW + YEAR, uri: str = "urn:c"
) -> Path:
    key = rsa.generate_private_key(public_exponent=65537, key_size=bits)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "client of a test")])
    made = x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number(), begins, ends)
    if uri:
        alternative = x509.SubjectAlternativeName([x509.UniformResourceIdentifier(uri)])
        made = made.add_extension(alternative, critical=False)
    file = folder / "client of a test.der"
    file.write_bytes(made.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.DER))
    return file


@pytest.fixture
def data(tmp_path: Path) -> Path:
    made = tmp_path / "data folder"
    made.mkdir(mode=0o700)
    return made


@pytest.mark.parametrize(
    ("wrong", "codes"),
    [
        ({}, []),
        ({"begins": NOW - 2 * YEAR, "ends": NOW - YEAR}, ["BadCertificateTimeInvalid"]),
        ({"begins": NOW + YEAR, "ends": NOW + 2 * YEAR}, ["BadCertificateTimeInvalid"]),
        ({"bits": 1024}, ["BadCertificatePolicyCheckFailed"]),
        ({"uri": ""}, ["BadCertificateUriInvalid"]),
        ({"bits": 1024, "uri": ""}, ["BadCertificatePolicyCheckFailed", "BadCertificateUriInvalid"]),
    ],
    ids=["good", "expired", "not yet valid", "short key", "no URI", "two at once"],
)
def test_trusting_says_for_what_a_certificate_is_still_refused(
    wrong: dict[str, Any], codes: list[str], data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = certificate(tmp_path, **wrong)
    assert status_of(["certificates", "trust", str(file), "--data", str(data)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert ("will still be refused" in said) == bool(codes)
    assert all(f"[{code}]" in said for code in codes)
    assert status_of(["certificates", "list", "--json", "--data", str(data)]) == 0
    [listed] = json.loads(capsys.readouterr().out)
    assert (listed["trusted"], listed["refused_for"]) == (True, codes)
    assert status_of(["certificates", "distrust", listed["thumbprint"][:10], "--data", str(data)]) == 0
    assert status_of(["certificates", "list", "--json", "--data", str(data)]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1]) == []


def test_what_others_may_read_is_said(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of(["certificates", "show", "--json", "--data", str(data)]) == 0
    assert json.loads(capsys.readouterr().out)["open_to_others"] == {}
    (data / "traces").mkdir(mode=0o755)
    (data / "traces" / "run.csv").write_text("t\n", encoding="utf-8")
    (data / "traces" / "run.csv").chmod(0o644)
    data.chmod(0o755)
    assert status_of(["certificates", "show", "--json", "--data", str(data)]) == 0
    told = json.loads(capsys.readouterr().out)["open_to_others"]
    assert told == {str(data): "755", str(data / "traces"): "755", str(data / "traces" / "run.csv"): "644"}
    (data / "certificates" / "server.pem").chmod(0o640)
    assert status_of(["certificates", "show", "--data", str(data)]) == 1
    assert "chmod 600 " in capsys.readouterr().err


def test_the_words_a_server_gives_lead_to_its_own_data_from_any_folder(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "a plant's settings.toml"
    config.write_text('database = "sqlite:///elsewhere.db"\n', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    options = shlex.split(data_options(load_settings(Path(config.name), data=Path(data.name)), Path(config.name)))
    assert options == ["--data", str(data), "--config", str(config)]
    monkeypatch.chdir(data)
    assert status_of(["certificates", "list", *options]) == 0
    assert status_of(["certificates", "trust", str(certificate(tmp_path)), "--data", "DIR"]) == 1
    assert "there is no data folder DIR" in " ".join(capsys.readouterr().err.split())

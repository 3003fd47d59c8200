"""Certificates made at first start, and the trust list."""

import os
import stat
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.x509.oid import ExtendedKeyUsageOID

from opcua_skill.security import SecuritySettings, TrustList, ensure_client_certificate, ensure_server_certificate
from opcua_skill.security import trust as trust_module

URI = "urn:plant:client"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory):
    return [ensure_client_certificate(tmp_path_factory.mktemp("client"), URI) for _ in range(3)]


def test_a_certificate_names_application_hosts_and_use(tmp_path: Path):
    made = ensure_server_certificate(tmp_path, "urn:plant:server", "plant", ("plant.example", "10.1.2.3"))
    certificate = made.certificate()
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.UniformResourceIdentifier) == ["urn:plant:server"]
    assert {"localhost", "plant.example"} <= set(names.get_values_for_type(x509.DNSName))
    assert {"127.0.0.1", "10.1.2.3"} <= {str(ip) for ip in names.get_values_for_type(x509.IPAddress)}
    use = certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert ExtendedKeyUsageOID.SERVER_AUTH in use
    assert certificate.public_key().key_size >= 2048


def test_a_second_start_keeps_the_certificate_and_the_key_is_private(tmp_path: Path):
    first = ensure_client_certificate(tmp_path, URI)
    assert ensure_client_certificate(tmp_path, URI).thumbprint() == first.thumbprint()
    assert stat.S_IMODE(first.key_file.stat().st_mode) == 0o600
    assert [file.name for file in tmp_path.iterdir() if file.name.startswith(".")] == []


def test_a_lost_certificate_is_made_again_from_the_same_key(tmp_path: Path):
    first = ensure_client_certificate(tmp_path, URI)
    key = first.key_file.read_bytes()
    first.certificate_file.unlink()
    assert ensure_client_certificate(tmp_path, URI).key_file.read_bytes() == key


def test_an_installation_has_a_name_of_its_own_and_keeps_it(tmp_path: Path):
    one, other = (ensure_server_certificate(tmp_path / name, "", "plant") for name in ("one", "other"))
    assert one.application_uri != other.application_uri
    assert one.installation != other.installation
    assert ensure_server_certificate(tmp_path / "one", "", "plant") == one
    for file in (one.certificate_file, one.key_file):
        file.unlink()
    assert ensure_server_certificate(tmp_path / "one", "", "plant") == one  # with another key, under the same name
    first = ensure_server_certificate(tmp_path / "old", "urn:opcua-skill:server", "plant")
    (tmp_path / "old" / "installation.json").unlink()
    old = ensure_server_certificate(tmp_path / "old", "", "plant")
    assert (old.application_uri, old.thumbprint()) == ("urn:opcua-skill:server", first.thumbprint())
    (tmp_path / "old" / "installation.json").write_text("[")
    with pytest.raises(ValueError, match="is damaged"):
        ensure_server_certificate(tmp_path / "old", "", "plant")


def test_a_certificate_of_another_application_is_not_used_silently(tmp_path: Path):
    ensure_client_certificate(tmp_path, URI)
    with pytest.raises(ValueError, match="urn:another"):
        ensure_client_certificate(tmp_path, "urn:another")


def test_trust_reject_and_distrust(tmp_path: Path, made):
    trust, certificate = TrustList(tmp_path), made[0].certificate()
    assert not trust.is_trusted(certificate)
    trust.reject(certificate)
    assert [(one.trusted, one.application_uri) for one in trust.listed()] == [(False, URI)]
    trust.trust_rejected(made[0].thumbprint()[:10].upper())
    assert [one.trusted for one in trust.listed()] == [True]
    assert trust.is_trusted(certificate)
    assert not trust.is_trusted(made[1].certificate())
    trust.distrust(made[0].thumbprint())
    assert not trust.is_trusted(certificate)


def test_a_certificate_is_trusted_from_pem_and_under_any_file_name(tmp_path: Path, made):
    trust = TrustList(tmp_path / "pki")
    pem = tmp_path / "client.crt"
    pem.write_bytes(made[0].certificate().public_bytes(serialization.Encoding.PEM))
    trust.trust(pem)
    (trust.trusted_folder / "dropped in by hand.cer").write_bytes(made[1].certificate_file.read_bytes())
    (trust.trusted_folder / "notes.der").write_bytes(b"not a certificate")
    assert trust.is_trusted(made[0].certificate())
    assert trust.is_trusted(made[1].certificate())
    assert not trust.is_trusted(made[2].certificate())


def test_a_file_that_is_no_certificate_is_refused_with_its_name(tmp_path: Path):
    wrong = tmp_path / "holiday.jpg"
    wrong.write_bytes(b"\xff\xd8\xff")
    with pytest.raises(ValueError, match=r"holiday\.jpg"):
        TrustList(tmp_path / "pki").trust(wrong)


@pytest.mark.parametrize("start", ["", "zz", "0x"])
def test_a_thumbprint_that_names_none_is_refused(tmp_path: Path, made, start: str):
    trust = TrustList(tmp_path)
    trust.reject(made[0].certificate())
    with pytest.raises(ValueError, match="0 rejected"):
        trust.trust_rejected(start)


def test_only_so_many_rejected_certificates_are_kept(tmp_path: Path, made, monkeypatch):
    monkeypatch.setattr(trust_module, "MAX_REJECTED", 2)
    trust = TrustList(tmp_path)
    for age, one in enumerate(made):
        trust.reject(one.certificate())
        file = trust.rejected_folder / f"{one.thumbprint()}.der"
        os.utime(file, (1_000_000 + age, 1_000_000 + age))
    trust.reject(made[2].certificate())
    assert {one.thumbprint for one in trust.listed()} == {one.thumbprint() for one in made[1:]}


def test_settings_refuse_a_policy_nobody_knows_and_none_at_all(tmp_path: Path):
    with pytest.raises(ValueError, match="Basic128"):
        SecuritySettings(tmp_path, policies=("Basic128",))
    with pytest.raises(ValueError, match="no security policy"):
        SecuritySettings(tmp_path, policies=())

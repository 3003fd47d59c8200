"""Certificates of authorities: accepted with their chain, refused when taken back, and each fault has its own code."""

from collections.abc import Callable
from pathlib import Path

import pytest
from asyncua import ua
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from opcua_skill.security import TrustList
from opcua_skill.security.chains import CertificateFault, Known, fault
from tests.opcua_skill.stack.authorities import DAY, DER, NOW, Authority, write
from tests.opcua_skill.stack.small_server import Bench, Row
from tests.opcua_skill.stack.test_sign_in import with_user_certificate


def judged(
    certificate: x509.Certificate,
    trusted: tuple[Authority, ...] = (),
    issuers: tuple[Authority, ...] = (),
    lists: tuple[x509.CertificateRevocationList, ...] = (),
    sent_along: tuple[Authority, ...] = (),
) -> CertificateFault | None:
    known = Known([one.certificate for one in trusted], [one.certificate for one in issuers], lists)
    return fault(certificate, known, NOW, [one.certificate for one in sent_along])


def test_what_a_trusted_authority_has_issued_is_good_until_it_is_taken_back():
    plant = Authority("plant")
    panel = plant.issue("panel")
    assert judged(panel, trusted=(plant,), lists=(plant.revocations(),)) is None
    plant.revoked.append(panel)
    assert judged(panel, trusted=(plant,), lists=(plant.revocations(),)) is CertificateFault.REVOKED
    assert judged(plant.issue("panel"), trusted=(plant,), lists=(plant.revocations(),)) is None


def test_a_chain_of_two_holds_wherever_the_middle_one_is_known_from():
    company = Authority("company")
    plant = Authority("plant", above=company)
    panel, lists = plant.issue("panel"), (company.revocations(), plant.revocations())
    assert judged(panel, trusted=(company,), issuers=(plant,), lists=lists) is None
    assert judged(panel, trusted=(company,), sent_along=(plant,), lists=lists) is None
    assert judged(panel, trusted=(plant,), issuers=(company,), lists=lists) is None
    assert judged(panel, trusted=(company,), lists=lists) is CertificateFault.INCOMPLETE
    assert judged(panel, issuers=(company, plant), lists=lists) is CertificateFault.UNTRUSTED
    assert judged(panel, sent_along=(company, plant), lists=lists) is CertificateFault.UNTRUSTED


def test_an_authority_that_was_taken_back_takes_its_certificates_with_it():
    company = Authority("company")
    plant = Authority("plant", above=company)
    company.revoked.append(plant.certificate)
    lists = (company.revocations(), plant.revocations())
    assert judged(plant.issue("panel"), (company,), (plant,), lists) is CertificateFault.ISSUER_REVOKED


def test_without_a_list_of_today_nobody_knows():
    company = Authority("company")
    plant = Authority("plant", above=company)
    panel = plant.issue("panel")
    today, late = plant.revocations(), plant.revocations(until=-DAY)
    assert judged(panel, (company,), (plant,), (company.revocations(),)) is CertificateFault.UNKNOWN
    assert judged(panel, (company,), (plant,), (company.revocations(), late)) is CertificateFault.UNKNOWN
    assert judged(panel, (company,), (plant,), (today,)) is CertificateFault.ISSUER_UNKNOWN
    forged = Authority("forger").revocations()
    assert judged(panel, (company,), (plant,), (forged, company.revocations())) is CertificateFault.UNKNOWN


def test_a_list_out_of_date_still_takes_back():
    plant = Authority("plant")
    panel = plant.issue("panel")
    plant.revoked.append(panel)
    assert judged(panel, (plant,), lists=(plant.revocations(until=-DAY),)) is CertificateFault.REVOKED


def test_a_certificate_trusted_by_itself_needs_no_authority_but_a_known_one_takes_it_back():
    plant = Authority("plant")
    panel = plant.issue("panel")
    assert fault(panel, Known([panel], [], []), NOW) is None
    assert fault(panel, Known([panel], [plant.certificate], []), NOW) is None
    plant.revoked.append(panel)
    assert fault(panel, Known([panel], [plant.certificate], [plant.revocations()]), NOW) is CertificateFault.REVOKED


@pytest.mark.parametrize(
    ("issue", "expected"),
    [
        (lambda plant: plant.issue("late", valid=(-3 * DAY, -DAY)), CertificateFault.TIME),
        (lambda plant: plant.issue("early", valid=(DAY, 2 * DAY)), CertificateFault.TIME),
        (lambda plant: plant.issue("mute", usage=("key_encipherment",)), CertificateFault.USE),
        (lambda plant: plant.issue("signer", usage=("digital_signature",)), CertificateFault.USE),
        (lambda plant: plant.issue("web", purposes=(ExtendedKeyUsageOID.SERVER_AUTH,)), CertificateFault.USE),
        (lambda plant: plant.issue("short", bits=1024), CertificateFault.POLICY),
    ],
    ids=["late", "early", "cannot sign", "cannot encrypt", "no client", "short key"],
)
def test_a_certificate_that_is_not_fit_is_refused_whoever_issued_it(
    issue: Callable[[Authority], x509.Certificate], expected: CertificateFault
):
    plant = Authority("plant")
    assert judged(issue(plant), trusted=(plant,), lists=(plant.revocations(),)) is expected


@pytest.mark.parametrize(
    ("middle", "expected"),
    [
        (Authority("plant", Authority("company"), valid=(-3 * DAY, -DAY)), CertificateFault.ISSUER_TIME),
        (Authority("plant", Authority("company"), is_authority=False), CertificateFault.ISSUER_USE),
        (Authority("plant", Authority("company", depth=0)), CertificateFault.ISSUER_USE),
    ],
    ids=["late", "no authority", "deeper than allowed"],
)
def test_an_authority_that_is_not_fit_is_refused(middle: Authority, expected: CertificateFault):
    assert middle.above is not None
    lists = (middle.revocations(), middle.above.revocations())
    assert judged(middle.issue("panel"), (middle.above,), (middle,), lists) is expected


def test_authorities_that_vouch_for_each_other_in_a_circle_end_the_walk():
    east, west = Authority("east"), Authority("west")
    east.above, west.above = west, east
    assert judged(east.issue("panel"), issuers=(east, west)) is CertificateFault.INCOMPLETE


@pytest.mark.asyncio(loop_scope="package")
async def test_a_client_of_the_plant_s_authority_signs_in_until_its_certificate_is_taken_back(
    bench: Bench, tmp_path: Path
):
    company = Authority("company")
    plant = Authority("plant", above=company)
    panel = plant.issue("panel")
    own = write(tmp_path / "panel", panel, "panel")
    pki = bench.server.security.folder
    with pytest.raises(ua.uaerrors.BadCertificateChainIncomplete):
        async with bench.client(certificate=own):
            pass
    assert "CN=panel" in [one.subject for one in TrustList(pki).listed() if not one.trusted]
    root = tmp_path / "company.der"
    root.write_bytes(company.certificate.public_bytes(DER))
    TrustList(pki).trust(root)
    (pki / "issuers" / "certs" / "plant.der").write_bytes(plant.certificate.public_bytes(DER))
    (pki / "trusted" / "crl" / "company.crl").write_bytes(company.revocations().public_bytes(DER))
    (pki / "issuers" / "crl" / "plant.crl").write_bytes(plant.revocations().public_bytes(DER))
    async with bench.client("engineer", certificate=own) as client:
        assert await client.get_node(bench.cell).call_method(f"{bench.index}:WhoAmI") == "engineer/engineer"
    plant.revoked.append(panel)
    (pki / "issuers" / "crl" / "plant.crl").write_bytes(plant.revocations().public_bytes(DER))
    with pytest.raises(ua.uaerrors.BadCertificateRevoked):
        async with bench.client("engineer", certificate=own):
            pass


@pytest.mark.asyncio(loop_scope="package")
async def test_a_user_certificate_of_yesterday_signs_nobody_in(bench: Bench, tmp_path: Path):
    late = Authority("plant").issue("robot", valid=(-3 * DAY, -DAY))
    bench.users.rows.append(Row("robot-of-yesterday", "operator", "", late.public_bytes(DER)))
    with pytest.raises(ua.uaerrors.BadIdentityTokenRejected):
        async with await with_user_certificate(bench, write(tmp_path / "robot", late, "robot")):
            pass

"""Who gets in: encryption and sign-in by default, trust in the channel's certificate, sessions that stay one's own."""

import stat
from pathlib import Path

import pytest
from asyncua import Client, ua
from asyncua.crypto.security_policies import (
    SecurityPolicyAes128Sha256RsaOaep,
    SecurityPolicyAes256Sha256RsaPss,
    SecurityPolicyBasic256Sha256,
)

from opcua_skill.security import TrustList, ensure_client_certificate
from opcua_skill.stack import server as server_module
from opcua_skill.stack.server import SkillServer, WrongAsyncua
from tests.opcua_skill.stack.small_server import CLIENT_URI, PASSWORD, Bench, Row, small_server, until

pytestmark = pytest.mark.asyncio(loop_scope="package")


async def test_only_encrypted_endpoints_are_offered_and_no_anonymous_sign_in(bench: Bench):
    endpoints = await bench.server.get_endpoints()
    assert {e.SecurityMode for e in endpoints} == {ua.MessageSecurityMode.SignAndEncrypt}
    assert len({e.SecurityPolicyUri for e in endpoints}) == 3
    kinds = {token.TokenType for e in endpoints for token in e.UserIdentityTokens}
    assert kinds == {ua.UserTokenType.UserName, ua.UserTokenType.Certificate}
    assert {e.EndpointUrl for e in endpoints} == {bench.server.url}


@pytest.mark.parametrize(
    "policy", [SecurityPolicyBasic256Sha256, SecurityPolicyAes128Sha256RsaOaep, SecurityPolicyAes256Sha256RsaPss]
)
async def test_every_policy_works(bench: Bench, policy):
    client = await bench.new_client()
    own = ensure_client_certificate(bench.folder / "client", CLIENT_URI)
    await client.set_security(
        policy, str(own.certificate_file), str(own.key_file), mode=ua.MessageSecurityMode.SignAndEncrypt
    )
    async with client:
        assert await client.get_node(bench.cell).call_method(f"{bench.index}:Add", 1.0, 2.0) == 3.0


async def test_without_encryption_nobody_gets_in(bench: Bench):
    client = Client(bench.server.url, timeout=5)
    client.set_user("admin")
    client.set_password(PASSWORD)
    with pytest.raises((ua.UaError, ConnectionError, TimeoutError)):
        async with client:
            pass


@pytest.mark.parametrize(("user", "password"), [("admin", "wrong password"), ("nobody", PASSWORD), ("admin", "")])
async def test_a_wrong_name_or_password_is_refused_with_one_and_the_same_code(bench: Bench, user, password):
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        async with bench.client(user, password):
            pass


async def test_anonymous_is_refused(bench: Bench):
    client = await bench.new_client(user="")
    with pytest.raises(ua.UaError):
        async with client:
            pass


async def test_an_untrusted_certificate_is_refused_kept_and_let_in_once_trusted(tmp_path: Path):
    async with small_server(tmp_path, trust_client=False) as bench:
        with pytest.raises(ua.uaerrors.BadCertificateUntrusted):
            async with bench.client():
                pass
        trust = TrustList(tmp_path / "server")
        (turned_away,) = trust.listed()
        assert (turned_away.trusted, turned_away.application_uri) == (False, CLIENT_URI)
        trust.trust_rejected(turned_away.thumbprint[:8])
        async with bench.client() as client:
            assert await client.get_node(bench.cell).call_method(f"{bench.index}:Add", 1.0, 2.0) == 3.0


async def test_another_one_s_trusted_certificate_in_the_request_does_not_help(bench: Bench, tmp_path: Path):
    trusted = ensure_client_certificate(bench.folder / "client", CLIENT_URI).certificate_file.read_bytes()
    stranger = await bench.new_client(certificate=tmp_path / "stranger")
    for named in (trusted, b""):
        stranger = await bench.new_client(certificate=tmp_path / "stranger")
        await stranger.connect_socket()
        await stranger.send_hello()
        await stranger.open_secure_channel()
        stranger.security_policy.host_certificate = named
        with pytest.raises(ua.uaerrors.BadCertificateInvalid):
            await stranger.create_session()
        stranger.disconnect_socket()


async def test_a_certificate_bound_to_another_application_is_refused(bench: Bench):
    client = await bench.new_client()
    client.application_uri = "urn:somebody:else"
    with pytest.raises(ua.uaerrors.BadCertificateUriInvalid):
        async with client:
            pass


async def test_session_tokens_cannot_be_guessed(bench: Bench):
    async with bench.client() as one, bench.client() as other:
        tokens = [c.uaclient.protocol.authentication_token for c in (one, other)]
    assert all(t.NodeIdType == ua.NodeIdType.ByteString and len(t.Identifier) == 32 for t in tokens)
    assert tokens[0] != tokens[1]


async def test_a_request_with_another_session_s_token_is_refused(bench: Bench):
    async with bench.client("observer") as one, bench.client("admin") as other:
        one.uaclient.protocol.authentication_token = other.uaclient.protocol.authentication_token
        with pytest.raises(ua.uaerrors.BadSessionIdInvalid):
            await one.nodes.server_state.read_value()
        assert await other.nodes.server_state.read_value() == 0


async def session_on_new_channel(bench: Bench, victim: Client, folder: Path, user: str) -> Client:
    """Return a client with a channel of its own, made to speak for the session of another client."""
    client = await bench.new_client(user, certificate=folder)
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    client.uaclient.protocol.authentication_token = victim.uaclient.protocol.authentication_token
    client._policy_ids = victim._policy_ids
    client._server_nonce = victim._server_nonce
    client.security_policy.peer_certificate = victim.security_policy.peer_certificate
    return client


async def test_a_session_cannot_be_taken_over_by_another_certificate_or_user(bench: Bench, tmp_path: Path):
    stranger_key = ensure_client_certificate(tmp_path / "stranger", CLIENT_URI)
    TrustList(bench.server.security.folder).trust(stranger_key.certificate_file)
    attempts = (
        (tmp_path / "stranger", "engineer", ua.uaerrors.BadSecurityChecksFailed),
        (bench.folder / "client", "observer", ua.uaerrors.BadIdentityChangeNotSupported),
    )
    async with bench.client("engineer") as victim:
        for folder, user, refused in attempts:
            thief = await session_on_new_channel(bench, victim, folder, user)
            with pytest.raises(refused):
                await thief.activate_session(user, PASSWORD)
            with pytest.raises(ua.uaerrors.BadSessionIdInvalid):
                await thief.nodes.server_state.read_value()
            thief.disconnect_socket()
        assert await victim.nodes.server_state.read_value() == 0


async def test_a_session_comes_back_on_a_new_channel_of_the_same_client_and_user(bench: Bench):
    client = await bench.new_client("engineer")
    await client.connect()
    again = await session_on_new_channel(bench, client, bench.folder / "client", "engineer")
    await again.activate_session("engineer", PASSWORD)
    assert await again.get_node(bench.cell).call_method(f"{bench.index}:Add", 1.0, 2.0) == 3.0
    again.disconnect_socket()
    client.disconnect_socket()


async def test_a_name_is_locked_for_a_while_after_failures_even_for_the_right_password(bench: Bench):
    bench.users.rows.append(Row("forgetful", "operator"))
    async with bench.client("forgetful", PASSWORD):
        pass
    for _ in range(5):
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            async with bench.client("forgetful", "wrong password"):
                pass
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        async with bench.client("forgetful", PASSWORD):
            pass
    async with bench.client("engineer", PASSWORD) as other:
        assert await other.nodes.server_state.read_value() == 0


async def with_user_certificate(bench: Bench, folder: Path) -> Client:
    client = await bench.new_client(user="")
    await client.load_client_certificate(str(folder / "client.der"))
    await client.load_private_key(str(folder / "client.pem"))
    return client


async def test_a_user_certificate_signs_its_user_in_and_no_other_does(bench: Bench, tmp_path: Path):
    robot = ensure_client_certificate(tmp_path / "robot", "urn:robot:user")
    ensure_client_certificate(tmp_path / "stranger", "urn:stranger:user")
    bench.users.rows.append(Row("robot", "operator", "", robot.certificate_file.read_bytes()))
    async with await with_user_certificate(bench, tmp_path / "robot") as client:
        assert await client.get_node(bench.cell).call_method(f"{bench.index}:WhoAmI") == "robot/operator"
    with pytest.raises(ua.uaerrors.BadUserAccessDenied):
        async with await with_user_certificate(bench, tmp_path / "stranger"):
            pass


async def test_a_user_certificate_without_its_key_is_worth_nothing(bench: Bench, tmp_path: Path):
    robot = ensure_client_certificate(tmp_path / "robot", "urn:robot:user")
    bench.users.rows.append(Row("robot-2", "operator", "", robot.certificate_file.read_bytes()))
    ensure_client_certificate(tmp_path / "stranger", "urn:stranger:user")
    client = await with_user_certificate(bench, tmp_path / "stranger")
    await client.load_client_certificate(str(robot.certificate_file))
    with pytest.raises(ua.uaerrors.BadUserSignatureInvalid):
        async with client:
            pass


async def test_guessing_costs_the_connection(bench: Bench):
    client = await bench.new_client("teacher", "wrong password")
    await client.connect_socket()
    await client.send_hello()
    await client.open_secure_channel()
    await client.create_session()
    for _ in range(3):
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            await client.activate_session("teacher", "wrong password")
    await until(lambda: client.uaclient.protocol.is_closed)
    client.disconnect_socket()


async def test_no_password_reaches_the_log(bench: Bench, caplog):
    caplog.set_level(1)
    async with bench.client("operator", PASSWORD):
        pass
    with pytest.raises(ua.UaError):
        async with bench.client("operator", "another password"):
            pass
    assert PASSWORD not in caplog.text
    assert "another password" not in caplog.text


async def test_the_end_of_a_session_is_told_to_those_who_hold_something_for_it(bench: Bench):
    ended: list[str] = []

    async def note(session_id: str) -> None:
        ended.append(session_id)

    bench.server.on_session_closed(note)
    async with bench.client() as client:
        await client.get_node(bench.cell).call_method(f"{bench.index}:WhoAmI")
    assert ended == [bench.records[-1].caller.session_id]


async def test_insecure_modes_are_off_and_said_aloud_when_on(tmp_path: Path, caplog):
    async with small_server(tmp_path / "safe") as bench:
        assert bench.server.insecure == ()
    switches = ("insecure_no_encryption", "insecure_anonymous", "insecure_trust_every_client")
    async with small_server(tmp_path / "open", trust_client=False, **dict.fromkeys(switches, True)) as bench:
        assert len(bench.server.insecure) == 3
        said = [r.getMessage() for r in caplog.records if r.levelname == "WARNING"]
        assert all(any(words in line for line in said) for words in bench.server.insecure)
        async with Client(bench.server.url) as anonymous:
            cell = anonymous.get_node(bench.cell)
            assert await cell.call_method(f"{bench.index}:WhoAmI") == "/observer"
            with pytest.raises(ua.uaerrors.BadUserAccessDenied):
                await cell.call_method(f"{bench.index}:Engineer")
        async with bench.client("engineer") as client:
            assert await client.nodes.server_state.read_value() == 0


async def test_the_private_key_is_readable_by_its_owner_alone(bench: Bench):
    assert bench.server.certificate is not None
    assert stat.S_IMODE(bench.server.certificate.key_file.stat().st_mode) == 0o600


async def test_another_version_of_asyncua_is_refused(bench: Bench, monkeypatch):
    monkeypatch.setattr(server_module.asyncua, "__version__", "2.2.0")
    with pytest.raises(WrongAsyncua, match=r"2\.2\.0"):
        SkillServer(bench.server.iserver.sign_in, bench.server.security)

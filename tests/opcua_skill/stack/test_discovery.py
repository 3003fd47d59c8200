"""Registration at a discovery server, and several servers side by side."""

from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from asyncua import Client, Server, ua

from tests.opcua_skill.stack.small_server import keys, small_server, until


async def discovery_server(*policies: ua.SecurityPolicyType) -> Server:
    """Return a discovery server: asyncua takes registrations from everybody, as such a server does."""
    server = Server()
    await server.init()
    server.set_endpoint("opc.tcp://127.0.0.1:0")
    await server.load_certificate(keys() / "server" / "server.der")
    await server.load_private_key(keys() / "server" / "server.pem")
    server.set_security_policy([ua.SecurityPolicyType.NoSecurity, *policies])
    return server


@pytest.mark.parametrize(
    "policies", [(), (ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,)], ids=["open", "encrypted"]
)
async def test_a_server_registers_and_takes_it_back_when_it_stops(tmp_path: Path, policies):
    async with await discovery_server(*policies) as finder:
        url = f"opc.tcp://127.0.0.1:{finder.bserver.port}"
        online: list[bool] = []
        taken = finder.iserver.register_server

        def register(server, configuration=None) -> None:
            online.append(server.IsOnline)
            taken(server, configuration)

        finder.iserver.register_server = register
        async with small_server(tmp_path, discovery_servers=(url,)) as bench:
            (registration,) = bench.server._registrations
            await until(lambda: registration.registered)
            found = await Client(url).connect_and_find_servers()
            mine = next(one for one in found if one.ApplicationUri == bench.server.security.application_uri)
            assert mine.DiscoveryUrls == [bench.server.url]
            assert (await Client(mine.DiscoveryUrls[0]).connect_and_get_server_endpoints())[
                0
            ].EndpointUrl == mine.DiscoveryUrls[0]
        assert (online[0], online[-1]) == (True, False)


async def test_a_discovery_server_that_is_away_does_not_keep_the_server_from_serving(tmp_path: Path):
    async with (
        small_server(tmp_path, discovery_servers=("opc.tcp://127.0.0.1:1",)) as bench,
        bench.client() as client,
    ):
        assert await client.nodes.server_state.read_value() == 0


async def test_several_servers_run_side_by_side_each_with_its_own_name(tmp_path: Path):
    async with AsyncExitStack() as stack:
        names = ("north", "south")
        benches = [
            await stack.enter_async_context(small_server(tmp_path / name, application_name=name)) for name in names
        ]
        told = [(await Client(b.server.url).connect_and_find_servers())[0].ApplicationName.Text for b in benches]
        assert told == list(names)
        for bench in benches:
            async with bench.client("engineer") as client:
                cell = client.get_node(bench.cell)
                assert await cell.call_method(f"{bench.index}:WhoAmI") == "engineer/engineer"

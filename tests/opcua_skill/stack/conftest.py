from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from tests.opcua_skill.stack.small_server import Bench, small_server
from tests.opcua_skill.stack.stock_server import Stock, stock_server


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def shared_bench(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Bench]:
    async with small_server(tmp_path_factory.mktemp("bench")) as running:
        yield running


@pytest_asyncio.fixture(loop_scope="package")
async def bench(shared_bench: Bench) -> Bench:
    """One server for all tests of this folder, without records and waiting sessions of the test before."""
    shared_bench.records.clear()
    for session in shared_bench.server.iserver.client_sessions():
        if session.processor is None:
            await session.close_session(True)
    return shared_bench


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def stock() -> AsyncIterator[Stock]:
    """One server as asyncua makes it for all tests of this folder."""
    async with stock_server() as running:
        yield running

from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest
import pytest_asyncio

from tests.opcua_skill.stack.small_server import Bench, small_server


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def shared_bench(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Bench]:
    async with small_server(tmp_path_factory.mktemp("bench")) as running:
        yield running


@pytest.fixture
def bench(shared_bench: Bench) -> Iterator[Bench]:
    """One server for all tests of a module, with its records cleared for each."""
    shared_bench.records.clear()
    yield shared_bench


@pytest_asyncio.fixture(loop_scope="module")
async def own_bench(tmp_path: Path) -> AsyncIterator[Bench]:
    """A server for one test that breaks or counts things."""
    async with small_server(tmp_path) as running:
        yield running

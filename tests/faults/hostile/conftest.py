from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from tests.faults.hostile.scene import Scene, scene


@pytest_asyncio.fixture(scope="module", loop_scope="module", name="scene")
async def attacked(tmp_path_factory: pytest.TempPathFactory) -> AsyncIterator[Scene]:
    async with scene(tmp_path_factory.mktemp("hostile")) as running:
        yield running

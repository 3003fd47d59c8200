"""A server that is asked to stop does."""

from pathlib import Path

from tests.opcua_skill.stack.small_server import small_server


async def test_stopping_does_not_wait_for_the_next_tick_of_the_clock(tmp_path: Path):
    async with small_server(tmp_path) as bench:
        clock = bench.server.iserver.time_task
        assert clock is not None
        assert not clock.done()
    assert clock.cancelled()

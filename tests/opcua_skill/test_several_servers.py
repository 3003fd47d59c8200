"""Two servers on one library: what one changes the other tells, and what only one may have one has."""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest
import pytest_asyncio
from small_corner import small_corner

from opcua_skill.client import SkillClient
from opcua_skill.client.errors import Refused
from opcua_skill.client.session import Event
from tests import postgres

if TYPE_CHECKING:
    from tests.conftest import Plant

STATION = '[[workstations]]\nname = "{name}"\ndriver = "kinematic"\nrealtime = {realtime}\n'
LIMIT = 120.0
TOLD_WITHIN = 20.0
"""s for an event to come from one server to the clients of the other on a loaded machine; a second is promised."""
pytestmark = [pytest.mark.slow, pytest.mark.asyncio(loop_scope="module")]


@pytest.fixture(scope="module")
def cluster() -> Iterator[postgres.Cluster]:
    """A PostgreSQL server with a prepared, empty library."""
    with postgres.cluster() as running:
        asyncio.run(postgres.prepare_template(running))
        yield running


@dataclass
class Two:
    """Two running servers, of `left` and of `right`, and engineers signed in at both."""

    left: "Plant"
    right: "Plant"
    engineers: tuple[SkillClient, SkillClient]

    async def learn(self, name: str) -> bytes:
        """Teach a skill at the left server and return its digest."""
        async with self.left.sign_in("teacher") as teacher:
            await teacher.learn_to_the_end(name, small_corner(), semantic_type="Gluing")
            return (await teacher.skill(name)).model_digest


@pytest_asyncio.fixture(scope="module", loop_scope="module")
async def two(cluster: postgres.Cluster, make_plant: Callable[..., "Plant"]) -> AsyncIterator[Two]:
    url = cluster.url("template_library")
    plants = [
        await asyncio.to_thread(make_plant, STATION.format(name=name, realtime=realtime), library=url)
        for name, realtime in (("left", "false"), ("right", "true"))
    ]
    async with AsyncExitStack() as stack:
        one, other = [await stack.enter_async_context(plant.sign_in("engineer")) for plant in plants]
        yield Two(plants[0], plants[1], (one, other))


async def told(events: "asyncio.Queue[Event]", message: str) -> float:
    """Wait for an event with a message and return how many seconds that took."""
    begun = time.monotonic()
    async with asyncio.timeout(TOLD_WITHIN):
        while (await events.get()).message != message:
            pass
    return time.monotonic() - begun


async def faults(client: SkillClient) -> list[str]:
    [kinds] = await client.session.read("SkillLibrary/FaultKinds")
    return list(kinds or [])


async def until(asked: Callable[[], Any]) -> None:
    async with asyncio.timeout(LIMIT):
        while not await asked():
            await asyncio.sleep(0.05)


async def test_what_one_server_stores_and_decides_is_told_to_the_clients_of_the_other(two: Two) -> None:
    left, right = two.engineers
    async with right.events() as events:
        digest = await two.learn("corner")
        await told(events, "corner version 1 is Learned, by teacher")
        await left.approve("corner", 1, digest, "well done")
        after = await told(events, "corner version 1 is Approved, by engineer")
        assert (await right.skill("corner")).state == "Approved"
        await left.deploy("corner", 1, "left")
        await told(events, "corner version 1 deployed on left by engineer")
        print(f"an approval was told at the other server {after * 1000:.0f} ms after it was answered")
    [summary] = await right.find_skills(workstation="left")
    assert summary.version == 1


async def test_two_approvals_at_once_are_one_winner_and_one_exact_refusal(two: Two) -> None:
    left, right = two.engineers
    digest = await two.learn("edge")
    answers = await asyncio.gather(
        left.approve("edge", 1, digest), right.approve("edge", 1, digest), return_exceptions=True
    )
    [refused] = [answer for answer in answers if isinstance(answer, BaseException)]
    assert isinstance(refused, Refused)
    assert (refused.status, answers.count("Approved")) == ("BadInvalidState", 1)


async def test_a_workstation_is_one_server_s_and_clients_are_told_whose(
    two: Two, cluster: postgres.Cluster, make_plant: Callable[..., "Plant"]
) -> None:
    for client in two.engineers:
        names, addresses = await client.session.read("SkillLibrary/LeasedWorkstations", "SkillLibrary/LeasedBy")
        assert dict(zip(names, addresses, strict=True)) == {"left": two.left.url, "right": two.right.url}
    settings = STATION.format(name="left", realtime="false")
    third = await asyncio.to_thread(make_plant, settings, library=cluster.url("template_library"), start=False)
    with pytest.raises(AssertionError, match=f"the workstation left is served by {two.left.url}"):
        await asyncio.to_thread(third.start)


async def test_a_server_that_has_lost_its_workstation_says_so_and_begins_nothing_there(
    two: Two, cluster: postgres.Cluster
) -> None:
    left, _ = two.engineers
    mine = "SELECT server FROM leases WHERE workstation = 'left'"
    [row] = await cluster.execute("template_library", mine)
    given = "UPDATE leases SET server = '{}', endpoint = 'opc.tcp://third', until = now() + interval '{}'"
    taken = f"{given} WHERE workstation = 'left'"
    await cluster.execute("template_library", taken.format("third", "1 hour"))
    await until(lambda: _has(left, "ServedElsewhere", True))
    async with two.left.sign_in("mes") as mes:
        with pytest.raises(Refused, match=r"served by opc\.tcp://third") as refused:
            await mes.workstation("left").execute("corner", mode="production")
        assert refused.value.status == "BadInvalidState"
    await cluster.execute("template_library", taken.format(row["server"], "1 second"))
    await until(lambda: _has(left, "ServedElsewhere", False))


async def test_a_run_goes_on_and_is_stored_though_the_database_goes_and_comes_meanwhile(
    two: Two, cluster: postgres.Cluster
) -> None:
    right = two.engineers[1]
    await right.deploy("corner", 1, "right")
    async with two.right.sign_in("mes") as mes:
        station = mes.workstation("right")
        await station.set_speed_override(0.3)
        started = await station.execute("corner", mode="production")

        async def moves() -> bool:
            return (await station.job(started.job_id)).state == "Running"

        await until(moves)
        await asyncio.to_thread(cluster.stop)
        await until(lambda: _has(right, "LibraryUnreachable", True))
        before = (await station.arm()).position
        await until(lambda: _moved(station, before))
        with pytest.raises(Refused) as refused:
            await station.execute("corner", mode="production")
        assert refused.value.status == "BadResourceUnavailable"
        await asyncio.to_thread(cluster.start)
        report = await mes.follow(started.job_id, on="right", limit=LIMIT)
        assert report.state == "Completed"
        assert len((await station.trace(started.job_id)).times) >= report.samples > 0, "slower than planned, and whole"
        await station.set_speed_override(1.0)
    await until(lambda: _has(right, "LibraryUnreachable", False))
    async with right.events() as events:
        await two.learn("after")
        await told(events, "after version 1 is Learned, by teacher")


async def test_a_server_that_was_killed_has_its_workstation_again_at_once_and_leaves_the_other_s_jobs_alone(
    two: Two,
) -> None:
    async with two.right.sign_in("mes") as mes:
        started = await mes.workstation("right").execute("corner", mode="production")
        await asyncio.to_thread(two.left.kill)
        await asyncio.to_thread(two.left.start)
        report = await mes.follow(started.job_id, on="right", limit=LIMIT)
    assert report.state == "Completed"


async def test_a_server_can_be_stopped_while_the_database_is_away_and_is_served_again_after_it(
    two: Two, cluster: postgres.Cluster
) -> None:
    await asyncio.to_thread(cluster.stop)
    try:
        await asyncio.to_thread(two.right.stop)
    finally:
        await asyncio.to_thread(cluster.start)
    await asyncio.to_thread(two.right.start)
    async with two.right.sign_in("engineer") as engineer:
        assert (await engineer.skill("corner")).state == "Approved"


async def _has(client: SkillClient, kind: str, wanted: bool) -> bool:
    return (kind in await faults(client)) is wanted


async def _moved(station: Any, before: Any) -> bool:
    return bool(abs((await station.arm()).position - before).max() > 1e-4)

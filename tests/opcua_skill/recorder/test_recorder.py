"""The recorder of a workstation: through the typed client, and through a client that knows nothing but OPC UA."""

import asyncio
import contextlib
from typing import TYPE_CHECKING

import numpy as np
import pytest
from asyncua import ua
from asyncua.client.client import Client
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from opcua_skill.client import APPLICATION_URI, Recorder, Refused, SkillClient
from tests.opcua_skill.recorder.conftest import LIMIT, PASSWORD, PEOPLE, show, until

if TYPE_CHECKING:
    from tests.conftest import Plant

pytestmark = pytest.mark.asyncio(loop_scope="module")


async def test_a_skill_is_learned_from_what_a_tracker_sent(people: dict[str, SkillClient], recorder: Recorder) -> None:
    teacher = people["teacher"]
    recording_id = await recorder.start(2, "Ada", "infrared tracker of cell 3")
    clock = 7.0
    for one in PEOPLE:
        clock = await show(recorder, recording_id, one, clock)
    found = await recorder.finish(recording_id)
    assert [one.demonstration_id for one in found] == [f"demonstration-{n:02d}" for n in range(1, 7)]
    for sent, kept in zip(PEOPLE, found, strict=True):
        np.testing.assert_allclose(kept.times, sent.times - sent.times[0], atol=1e-9)
        assert kept.points.tobytes() == sent.points.tobytes()
        assert kept.recorded_at is not None
    learned = await recorder.learn(recording_id, "recorded-plate", "Gluing")
    report = await teacher.follow(learned.job_id)
    assert report.state == "Completed", report
    stored = await teacher.recordings("recorded-plate")
    assert {(one.operator, one.source) for one in stored.raw} == {("Ada", "infrared tracker of cell 3")}
    document = (await teacher.skill("recorded-plate")).document
    assert document["provenance"]["recordings"][0]["operator"] == "Ada"


async def test_the_tools_orientation_is_recorded_and_learned(
    people: dict[str, SkillClient], recorder: Recorder
) -> None:
    recording_id = await recorder.start(3, "Ada")
    clock = 0.0
    times = np.arange(101) / 100
    for shift in (0.0, 0.001, -0.001):
        points = np.column_stack([0.1 * times, 0.02 * np.sin(3 * times) + shift, 0.01 * times])
        half = (0.4 * times + shift) / 2
        turned = np.column_stack([np.zeros((101, 2)), np.sin(half), np.cos(half)])
        button = np.repeat([True, False], [91, 10])
        await recorder.append(recording_id, clock + times, points, button, turned)
        clock += 1.1
    view = await people["visitor"].workstation("ws1").recorder.recording()
    assert view.orientations is not None
    assert view.orientations.shape == (303, 4)
    found = await recorder.finish(recording_id)
    for one in found:
        assert one.orientations is not None
        np.testing.assert_allclose(np.linalg.norm(one.orientations, axis=1), 1.0, rtol=1e-12)
    learned = await recorder.learn(recording_id, "recorded-tool", "Sealing")
    report = await people["teacher"].follow(learned.job_id)
    assert report.state == "Completed", report
    motion = (await people["teacher"].skill("recorded-tool")).motion()
    assert motion.has_orientation
    end = motion.orientations_at(np.array([1.0]))[0]
    assert end[2] == pytest.approx(np.sin(0.18), abs=0.01)


async def test_a_panel_follows_by_subscription_and_fetches_what_is_new(
    people: dict[str, SkillClient], recorder: Recorder
) -> None:
    watched = people["visitor"].workstation("ws1").recorder
    recording_id = await recorder.start(3, source="a test")
    seen: list[int] = []
    told = asyncio.Event()

    class Watch:
        def datachange_notification(self, node: object, value: int, data: object) -> None:
            seen.append(value)
            told.set()

    client = people["visitor"].session._client
    subscription = await client.create_subscription(50, Watch())  # pyright: ignore[reportArgumentType]
    await subscription.subscribe_data_change(client.get_node(watched.session.node(f"{watched.path}/Samples")))
    times, points = np.arange(500) / 100, np.arange(1500).reshape(500, 3) / 1e4
    button = np.repeat([False, True, False, True], [100, 150, 50, 200])
    known = 0
    for cut in range(0, 500, 50):
        told.clear()
        await recorder.append(recording_id, times[cut : cut + 50], points[cut : cut + 50], button[cut : cut + 50])
        async with asyncio.timeout(LIMIT):
            while not seen or seen[-1] < cut + 50:
                await told.wait()
                told.clear()
        view = await watched.recording(after=known)
        np.testing.assert_allclose(view.positions, points[known : cut + 50])
        np.testing.assert_allclose(view.times, times[known : cut + 50])
        assert np.array_equal(view.triggers, button[known : cut + 50])
        assert (view.recording_id, view.dimension, view.recording, view.source) == (recording_id, 3, True, "a test")
        assert view.operator == "teacher"
        known += len(view.times)
    await subscription.delete()
    state = await watched.state()
    assert (state.recording, state.trigger, state.recording_id) == (True, True, recording_id)
    assert (state.samples, state.demonstrations) == (500, 2)
    presses = await watched.presses()
    assert (presses.first, presses.last, presses.goes_on) == ((100, 300), (249, 499), True)
    first = await watched.demonstration(recording_id, presses.ids[0])
    np.testing.assert_allclose(first.points, points[100:250])
    with pytest.raises(Refused) as refusal:
        await watched.demonstration(recording_id, presses.ids[1])
    assert refusal.value.status == "BadInvalidState"


async def test_a_button_can_be_written_where_samples_have_none(recorder: Recorder) -> None:
    recording_id = await recorder.start(2)
    times, points = np.arange(400) / 100, np.zeros((400, 2))
    for quarter, pressed in enumerate((False, True, False, True)):
        await recorder.press(pressed)
        part = slice(100 * quarter, 100 * quarter + 100)
        await recorder.append(recording_id, times[part], points[part])
    presses = await recorder.presses()
    assert list(zip(presses.first, presses.last, strict=True)) == [(100, 199), (300, 399)]


async def test_presses_that_are_too_short_are_told(recorder: Recorder) -> None:
    recording_id = await recorder.start(2)
    button = np.repeat([False, True, False, True, False], [50, 3, 50, 60, 50])
    await recorder.append(recording_id, np.arange(213) / 100, np.zeros((213, 2)), button)

    async def told() -> bool:
        state = await recorder.state()
        return state.ignored == 1 and "3 samples" in state.last_ignored and state.demonstrations == 1

    await until(told)


async def test_a_discarded_demonstration_is_not_learned_from(recorder: Recorder) -> None:
    recording_id = await recorder.start(2)
    clock = 0.0
    for one in PEOPLE[:3]:
        clock = await show(recorder, recording_id, one, clock)
    with pytest.raises(Refused) as going_on:
        await recorder.discard(recording_id, "demonstration-03")
    assert going_on.value.status == "BadInvalidState"
    assert await recorder.discard(recording_id, "demonstration-02") == 1
    found = await recorder.finish(recording_id)
    assert [one.demonstration_id for one in found] == ["demonstration-01", "demonstration-03"]
    assert await recorder.discard(recording_id, "demonstration-01") == 1
    with pytest.raises(Refused) as too_few:
        await recorder.learn(recording_id, "lonely", "Gluing")
    assert (too_few.value.status, too_few.value.argument) == ("BadInvalidArgument", "RecordingId")
    assert await recorder.discard(recording_id) == 0
    with pytest.raises(Refused) as gone:
        await recorder.recording(recording_id)
    assert gone.value.status == "BadNotFound"


async def test_a_lost_session_closes_its_recording_and_loses_nothing(
    plant: "Plant", people: dict[str, SkillClient], recorder: Recorder
) -> None:
    gateway = plant.sign_in("teacher")
    await gateway.session.open()
    mine = gateway.workstation("ws1").recorder
    recording_id = await mine.start(2, "Ada")
    await mine.append(recording_id, np.arange(100) / 100, np.zeros((100, 2)))
    with pytest.raises(Refused, match="recording for teacher") as second:
        await people["engineer"].workstation("ws1").recorder.start(2)
    assert second.value.status == "BadInvalidState"
    await gateway.session.close()

    async def closed() -> bool:
        state = await recorder.state()
        return not state.recording and state.samples == 100 and state.recording_id == recording_id

    await until(closed)
    another = await recorder.start(2)
    [kept] = await recorder.finish(recording_id)
    assert kept.operator == "Ada"
    assert len(kept.times) == 100
    await recorder.discard(another)


async def test_a_gateway_that_died_is_in_nobodys_way(plant: "Plant", recorder: Recorder) -> None:
    gateway = plant.sign_in("teacher")
    await gateway.session.open()
    mine = gateway.workstation("ws1").recorder
    lost = await mine.start(2, "Ada")
    await mine.append(lost, np.arange(100) / 100, np.zeros((100, 2)))
    protocol = gateway.session._client.uaclient.protocol
    assert protocol is not None
    assert protocol.transport is not None
    protocol.transport.abort()

    async def begun() -> bool:
        try:
            await recorder.start(2)
        except Refused as refused:
            assert refused.status == "BadInvalidState"
            return False
        return True

    await until(begun)
    assert (await recorder.recording()).samples == 0
    [kept] = await recorder.finish(lost)
    assert len(kept.times) == 100
    await gateway.session.close()


async def test_workstations_record_apart(people: dict[str, SkillClient], recorder: Recorder) -> None:
    other = people["engineer"].workstation("ws2").recorder
    mine, theirs = await recorder.start(2), await other.start(3)
    await recorder.append(mine, [0.0, 0.1], np.zeros((2, 2)))
    assert (await other.recording()).samples == 0
    with pytest.raises(Refused) as foreign:
        await other.append(mine, [0.2, 0.3], np.zeros((2, 2)))
    assert foreign.value.status == "BadNotFound"
    assert await other.discard(theirs) == 0


async def test_a_long_recording_is_fetched_in_pieces(recorder: Recorder) -> None:
    recording_id = await recorder.start(2)
    points = np.random.default_rng(1).normal(size=(110_000, 2)) * 0.1
    times = np.arange(len(points)) / 1000
    button = np.ones(len(points), dtype=bool)
    button[50_000:50_200] = False
    for cut in range(0, len(points), 10_000):
        part = slice(cut, cut + 10_000)
        await recorder.append(recording_id, times[part], points[part], button[part])
    view = await recorder.recording()
    assert view.positions.tobytes() == points.tobytes()
    first, second = await recorder.finish(recording_id)
    assert first.points.tobytes() == points[:50_000].tobytes()
    assert second.points.tobytes() == points[50_200:].tobytes()


async def test_only_starting_finishing_and_discarding_are_recorded_in_the_audit_trail(
    plant: "Plant", recorder: Recorder
) -> None:
    import sqlite3

    def actions() -> list[str]:
        with contextlib.closing(sqlite3.connect(f"file:{plant.database}?mode=ro", uri=True)) as connection:
            return [row[0] for row in connection.execute("SELECT action FROM audit ORDER BY rowid")]

    before = len(await asyncio.to_thread(actions))
    recording_id = await recorder.start(2)
    for cut in range(5):
        await recorder.append(recording_id, cut + np.arange(10) / 100, np.zeros((10, 2)))
    await recorder.recording()
    await recorder.finish(recording_id)
    await recorder.discard(recording_id)
    assert (await asyncio.to_thread(actions))[before:] == ["StartRecording", "FinishRecording", "DiscardRecording"]


async def test_a_bare_opc_ua_client_can_record(plant: "Plant", recorder: Recorder) -> None:
    mine = plant.client_folder
    client = Client(plant.url, timeout=30, watchdog_intervall=30.0)
    client.application_uri = APPLICATION_URI
    client.set_user("teacher")
    client.set_password(PASSWORD)
    certificate, key = sorted(mine.glob("*.der"))[0], sorted(mine.glob("*.pem"))[0]
    await client.set_security(SecurityPolicyBasic256Sha256, str(certificate), str(key))
    async with client:
        await client.load_data_type_definitions()
        machines = next(
            one for one in await client.nodes.objects.get_children_descriptions() if one.BrowseName.Name == "Machines"
        )
        types = await client.get_namespace_index("urn:opcua-skill:types")
        instances = await client.get_namespace_index("urn:opcua-skill:instances")
        there = await client.get_node(machines.NodeId).get_child([f"{instances}:ws1", f"{types}:Recorder"])
        recording_id = await there.call_method(
            f"{types}:StartRecording", ua.Variant(2, ua.VariantType.Byte), "", "bare"
        )
        times, places = [n / 100 for n in range(50)], [n / 1000 for n in range(100)]
        button = [10 <= n < 40 for n in range(50)]
        none = ua.Variant([], ua.VariantType.Double, is_array=True)
        samples, demonstrations = await there.call_method(
            f"{types}:AppendSamples", recording_id, times, places, button, none
        )
        assert (samples, demonstrations) == (50, 1)
        [shown] = await there.call_method(f"{types}:FinishRecording", recording_id)
        assert (shown.DemonstrationId, shown.Dimension, shown.Source) == ("demonstration-01", 2, "bare")
        np.testing.assert_allclose(shown.Positions, places[20:80])
        assert await there.call_method(f"{types}:DiscardRecording", recording_id, "") == 0

"""How long a recorder keeps what it has: closed recordings for an hour, the newest few, and never without bound."""

import asyncio
import contextlib
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from opcua_skill.configuration.settings import Limits
from opcua_skill.security.access import Caller, Role, calling_as
from opcua_skill.server.features import recorder as rules
from opcua_skill.server.features.library import LibraryMethods
from opcua_skill.server.features.recorder import KEPT, KEPT_SECONDS, RecorderMethods
from opcua_skill.stack.services.calls import Refused


class Scene:
    """A recorder with a clock to turn and sessions to lose; nothing is learned here, so there is no library."""

    def __init__(self) -> None:
        self.now = 0.0
        self.lost: set[str] = set()
        library = cast(LibraryMethods, None)
        self.recorder = RecorderMethods("ws1", library, Limits(), lambda name: name not in self.lost, lambda: self.now)
        self._told = 0.0

    async def start(self, session: str = "one") -> str:
        with calling_as(Caller("ada", Role.TEACHER, session, "")):
            [name] = await self.recorder.start_recording(2, "", "")
        return name

    async def append(self, name: str, count: int, session: str = "one") -> Any:
        times = [self._told + n / 100 for n in range(1, count + 1)]
        self._told += count / 100
        with calling_as(Caller("ada", Role.TEACHER, session, "")):
            return await self.recorder.append_samples(name, times, [0.0] * 2 * count, [], [])

    async def there(self, name: str) -> bool:
        try:
            await self.recorder.get_recording(name, 0)
        except Refused:
            return False
        return True


@pytest.fixture
def scene() -> Scene:
    return Scene()


async def test_a_closed_recording_is_kept_for_an_hour_and_an_open_one_for_ever(scene: Scene) -> None:
    closed = await scene.start()
    await scene.append(closed, 10)
    scene.recorder.session_closed("one")
    opened = await scene.start()
    scene.now = KEPT_SECONDS - 1
    assert await scene.there(closed)
    scene.now = KEPT_SECONDS + 1
    assert not await scene.there(closed)
    scene.now = 100 * KEPT_SECONDS
    assert await scene.there(opened)


async def test_the_newest_few_are_kept(scene: Scene) -> None:
    names = []
    for _ in range(KEPT + 3):
        names.append(await scene.start())
        scene.recorder.session_closed("one")
    assert [await scene.there(name) for name in names] == [False] * 3 + [True] * KEPT
    assert scene.recorder.newest is not None
    assert scene.recorder.newest.recording_id == names[-1]


async def test_room_is_made_of_the_oldest_and_one_recording_has_its_bound(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rules, "ALL_SAMPLES", 100)
    first = await scene.start()
    await scene.append(first, 40)
    scene.recorder.session_closed("one")
    second = await scene.start()
    await scene.append(second, 40)
    scene.recorder.session_closed("one")
    third = await scene.start()
    await scene.append(third, 20)
    assert [await scene.there(name) for name in (first, second, third)] == [True, True, True]
    await scene.append(third, 1)
    assert [await scene.there(name) for name in (first, second, third)] == [False, True, True]
    await scene.append(third, 79)
    assert [await scene.there(name) for name in (second, third)] == [False, True]
    with pytest.raises(Refused, match="holds 100 samples"):
        await scene.append(third, 1)


async def test_a_refused_append_forgets_nothing(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rules, "ALL_SAMPLES", 100)
    first = await scene.start()
    await scene.append(first, 90)
    scene.recorder.session_closed("one")
    second = await scene.start()
    with calling_as(Caller("ada", Role.TEACHER, "one", "")), pytest.raises(Refused):
        await scene.recorder.append_samples(second, [1.0] * 20, [0.0] * 40, [], [])
    assert await scene.there(first)


async def test_a_session_that_lost_its_connection_gives_way_and_one_that_has_it_does_not(scene: Scene) -> None:
    mine = await scene.start("one")
    with pytest.raises(Refused, match="finish or discard"):
        await scene.start("two")
    scene.lost.add("one")
    theirs = await scene.start("two")
    assert await scene.there(mine)
    with pytest.raises(Refused, match="closed"):
        await scene.append(mine, 5, "one")
    await scene.append(theirs, 5, "two")


async def test_a_button_that_was_written_is_forgotten_with_its_recording(scene: Scene) -> None:
    with pytest.raises(Refused, match="start a recording first"):
        await scene.recorder.press(True)
    await scene.start()
    await scene.recorder.press(True)
    assert scene.recorder.trigger
    scene.recorder.session_closed("one")
    assert not scene.recorder.trigger
    await scene.start()
    assert scene.recorder.button is None


STEPS = ("start", "append", "finish", "discard", "discard one", "lose", "wait", "press", "release", "read")


@given(st.lists(st.tuples(st.sampled_from(STEPS), st.sampled_from(["one", "two"]), st.integers(0, 40)), max_size=40))
@settings(deadline=None, max_examples=150)
def test_whatever_is_asked_in_whatever_order_the_recorder_stays_consistent(steps: list[tuple[str, str, int]]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        # The structures of the wire exist where a server has loaded its types; here the values do.
        patch.setattr(rules, "wire_demonstration", lambda one: one)
        asyncio.run(whatever(steps))


async def whatever(steps: list[tuple[str, str, int]]) -> None:
    """Ask in this order; a refusal is an answer, anything else that is raised is a fault."""
    scene, names, counted = Scene(), ["none"], dict[str, int]()
    recorder = scene.recorder
    for step, session, number in steps:
        name = names[-1 - (number % 5 == 0) * (len(names) - 1) // 2]
        with calling_as(Caller("ada", Role.TEACHER, session, "")), contextlib.suppress(Refused):
            if step == "start":
                names += await recorder.start_recording(2, "", "")
            elif step == "append":
                samples, _ = await scene.append(name, number, session)
                counted[name] = counted.get(name, 0) + number
                assert samples == counted[name]
            elif step == "finish":
                [shown] = await recorder.finish_recording(name)
                assert all(len(one.times) >= 3 for one in shown)
            elif step == "discard":
                await recorder.discard_recording(name, "")
            elif step == "discard one":
                await recorder.discard_recording(name, "demonstration-01")
            elif step == "lose":
                recorder.session_closed(session)
            elif step == "wait":
                scene.now += 100.0 * number
                recorder.forget_old()
            elif step == "read":
                await recorder.get_recording("", number)
                await recorder.list_demonstrations(name)
            else:
                await recorder.press(step == "press")
        kept = [one.recording for one in recorder._kept.values()]
        assert sum(one.is_open for one in kept) <= 1
        assert len(kept) <= KEPT
        for one in kept:
            assert one.samples == counted.get(one.recording_id, 0)
            ends = [bound for press in one.all_presses for bound in (press.first, press.end)]
            assert ends == sorted(ends)
            assert not ends or ends[-1] <= one.samples

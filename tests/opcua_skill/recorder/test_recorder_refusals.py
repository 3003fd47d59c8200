"""What a recorder refuses: exactly said, and nothing taken; limits, roles, and samples of another session."""

from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from library.store import SkillLibrary
from opcua_skill.client import Recorder, Refused, SkillClient
from opcua_skill.security import hash_password
from tests.opcua_skill.recorder.conftest import PASSWORD

if TYPE_CHECKING:
    from tests.conftest import Plant

pytestmark = pytest.mark.asyncio(loop_scope="module")


Call = Callable[[Recorder, str], Awaitable[Any]]
ROWS: list[tuple[str, Call, str, tuple[str, str]]] = [
    ("dimension", lambda r, _: r.start(4), "BadInvalidArgument", ("Dimension", "BadOutOfRange")),
    ("operator", lambda r, _: r.start(2, "A" * 600), "BadInvalidArgument", ("Operator", "BadOutOfRange")),
    ("source", lambda r, _: r.start(2, "", "A" * 600), "BadInvalidArgument", ("Source", "BadOutOfRange")),
    ("second recording", lambda r, _: r.start(2), "BadInvalidState", ("", "")),
    ("NaN", lambda r, i: r.append(i, [9.0], [[np.nan, 0.0]]), "BadInvalidArgument", ("Positions", "BadOutOfRange")),
    ("lengths", lambda r, i: r.append(i, [9.0], [[0.0]]), "BadInvalidArgument", ("Positions", "BadOutOfRange")),
    ("times", lambda r, i: r.append(i, [0.0], [[0.0, 0.0]]), "BadInvalidArgument", ("Times", "BadOutOfRange")),
    (
        "triggers",
        lambda r, i: r.append(i, [9.0], [[0.0, 0.0]], [True, True]),
        "BadInvalidArgument",
        ("Triggers", "BadOutOfRange"),
    ),
    (
        "orientations",
        lambda r, i: r.append(i, [9.0], [[0.0, 0.0]], orientations=[[0.0, 0.0, 0.0, 1.0]]),
        "BadInvalidArgument",
        ("Orientations", "BadOutOfRange"),
    ),
    (
        "too much",
        lambda r, i: r.append(i, 9 + np.arange(10_001) / 1e4, np.zeros((10_001, 2))),
        "BadRequestTooLarge",
        ("", ""),
    ),
    ("unknown", lambda r, _: r.append("none", [9.0], [[0.0, 0.0]]), "BadNotFound", ("RecordingId", "BadNotFound")),
    ("after", lambda r, i: r.recording(i, 11), "BadInvalidArgument", ("After", "BadOutOfRange")),
    ("no such demonstration", lambda r, i: r.discard(i, "none"), "BadNotFound", ("DemonstrationId", "BadNotFound")),
    ("learn from an open one", lambda r, i: r.learn(i, "new", "Gluing"), "BadInvalidState", ("", "")),
]


@pytest.mark.parametrize(("call", "status", "argument"), [row[1:] for row in ROWS], ids=[row[0] for row in ROWS])
async def test_a_refusal_is_exact_and_takes_nothing(
    call: Call, status: str, argument: tuple[str, str], recorder: Recorder
) -> None:
    recording_id = await recorder.start(2)
    await recorder.append(recording_id, np.arange(10) / 100, np.zeros((10, 2)))
    with pytest.raises(Refused) as refused:
        await call(recorder, recording_id)
    assert refused.value.status == status, refused.value
    assert (refused.value.argument, refused.value.argument_status) == argument, refused.value
    assert refused.value.reason
    view = await recorder.recording()
    assert (view.recording_id, view.samples, view.recording) == (recording_id, 10, True)


async def test_limits_of_a_demonstration_are_those_of_the_library(recorder: Recorder) -> None:
    recording_id = await recorder.start(2)
    for cut in range(6):
        await recorder.append(recording_id, cut + np.arange(10_000) / 1e4, np.zeros((10_000, 2)))
    with pytest.raises(Refused, match="release the button") as longer:
        await recorder.append(recording_id, [7.0], [[0.0, 0.0]])
    assert longer.value.status == "BadRequestTooLarge"
    times, button = 8 + np.arange(13 * 20) / 100, np.tile(np.repeat([False, True], 10), 13)
    with pytest.raises(Refused, match="12 demonstrations") as more:
        await recorder.append(recording_id, times, np.zeros((len(times), 2)), button)
    assert more.value.status == "BadRequestTooLarge"
    assert (await recorder.recording(after=60_000)).samples == 60_000


@pytest.mark.parametrize("who", ["visitor", "mes"])
async def test_recording_is_for_teachers_and_watching_for_everybody(
    who: str, people: dict[str, SkillClient], recorder: Recorder
) -> None:
    recording_id = await recorder.start(2)
    theirs = people[who].workstation("ws1").recorder
    for call in (
        theirs.start(2),
        theirs.append(recording_id, [0.0], [[0.0, 0.0]]),
        theirs.finish(recording_id),
        theirs.discard(recording_id),
        theirs.learn(recording_id, "new", "Gluing"),
        theirs.press(True),
    ):
        with pytest.raises(Refused) as refused:
            await call
        assert refused.value.status in {"BadUserAccessDenied", "BadNotWritable"}
    assert (await theirs.recording()).recording_id == recording_id


async def test_another_session_cannot_mix_its_samples_in(people: dict[str, SkillClient], recorder: Recorder) -> None:
    recording_id = await recorder.start(2)
    theirs = people["engineer"].workstation("ws1").recorder
    with pytest.raises(Refused, match="fed by teacher") as mixed:
        await theirs.append(recording_id, [0.0], [[0.0, 0.0]])
    assert mixed.value.status == "BadInvalidState"
    assert await theirs.finish(recording_id) == []
    with pytest.raises(Refused, match="closed") as closed:
        await recorder.append(recording_id, [0.0], [[0.0, 0.0]])
    assert closed.value.status == "BadInvalidState"


async def test_a_recording_belongs_to_who_began_it_and_to_engineers(
    people: dict[str, SkillClient], recorder: Recorder, plant: "Plant"
) -> None:
    async with await SkillLibrary.open(plant.database) as library:
        await library.add_user("other-teacher", "teacher", hash_password(PASSWORD))
    recording = await recorder.start(3, "", "test")
    async with plant.sign_in("other-teacher") as other:
        theirs = other.workstation("ws1").recorder
        for attempt in (lambda: theirs.finish(recording), lambda: theirs.discard(recording)):
            with pytest.raises(Refused, match="belongs to teacher: ask them or an engineer") as refusal:
                await attempt()
            assert refusal.value.status == "BadUserAccessDenied"
        await recorder.finish(recording)
        await theirs.finish(recording)
        with pytest.raises(Refused, match="belongs to teacher"):
            await theirs.learn(recording, "stolen", "Gluing")
    await people["engineer"].workstation("ws1").recorder.discard(recording)

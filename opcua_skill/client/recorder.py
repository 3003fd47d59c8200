"""A workstation's recorder as a client sees it: a tracker feeds it, a panel watches it, a skill is learned from it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from asyncua import ua

from models.demonstration import Bools, Demonstration, Floats
from opcua_skill.client.session import Session
from opcua_skill.wire import to_server
from opcua_skill.wire.values import Learned, LearningOptions


@dataclass(frozen=True, slots=True)
class Recorded:
    """What an append answered: how many samples and demonstrations the recording has now."""

    samples: int
    demonstrations: int


@dataclass(frozen=True, slots=True)
class RecorderState:
    """What the recorder's variables show; ``ignored`` counts presses that were too short to be a demonstration."""

    recording: bool
    trigger: bool
    recording_id: str
    samples: int
    demonstrations: int
    ignored: int
    last_ignored: str


@dataclass(frozen=True, slots=True, eq=False)
class RecordingView:
    """A recording and its samples after those that were known: ``times`` (n,) in s from its first sample on.

    ``positions`` (n, d) in m, ``triggers`` (n,), ``orientations`` (n, 4) x y z w or None; ``samples`` counts all there
    are.
    """

    recording_id: str
    dimension: int
    operator: str
    source: str
    recording: bool
    samples: int
    times: Floats
    positions: Floats
    triggers: Bools
    orientations: Floats | None


@dataclass(frozen=True, slots=True)
class Presses:
    """The demonstrations of a recording by their samples, ``last`` included; ``goes_on``: the last is shown now."""

    ids: tuple[str, ...]
    first: tuple[int, ...]
    last: tuple[int, ...]
    goes_on: bool


class Recorder:
    """The methods and variables under ``Machines/<workstation>/Recorder``."""

    def __init__(self, session: Session, path: str) -> None:
        self.session = session
        self.path = path

    async def start(self, dimension: int, operator: str = "", source: str = "") -> str:
        """Begin a recording, fed by this session; return its id. ``operator`` empty: who is signed in."""
        [recording_id] = await self.session.call(
            self.path,
            "StartRecording",
            Dimension=ua.Variant(dimension, ua.VariantType.Byte),
            Operator=to_server.string(operator),
            Source=to_server.string(source),
        )
        return recording_id

    async def append(
        self,
        recording_id: str,
        times: Sequence[float] | Floats,
        positions: Sequence[Sequence[float]] | Floats,
        triggers: Sequence[bool] | Bools | None = None,
        orientations: Sequence[Sequence[float]] | Floats | None = None,
    ) -> Recorded:
        """Add samples, all or none: ``times`` (n,) in s, ``positions`` (n, d) in m, what was not seen left out.

        ``triggers`` (n,) is the push button, None where `press` tells it; ``orientations`` (n, 4) x y z w.
        """
        samples, demonstrations = await self.session.call(
            self.path,
            "AppendSamples",
            RecordingId=to_server.string(recording_id),
            Times=_doubles(times),
            Positions=_doubles(positions),
            Triggers=_booleans(() if triggers is None else triggers),
            Orientations=_doubles(() if orientations is None else orientations),
        )
        return Recorded(int(samples), int(demonstrations))

    async def finish(self, recording_id: str) -> list[Demonstration]:
        """End a recording and return its demonstrations; long ones are fetched one by one."""
        [values] = await self.session.call(self.path, "FinishRecording", RecordingId=to_server.string(recording_id))
        return [
            to_server.demonstration_in(one)
            if one.Times
            else await self.demonstration(recording_id, one.DemonstrationId)
            for one in values or ()
        ]

    async def recording(self, recording_id: str = "", after: int = 0) -> RecordingView:
        """Return a recording and all its samples after the first ``after`` ones; no id: the open or the newest one."""
        pages = [await self._page(recording_id, after)]
        known = after + len(pages[0].times)
        while len(pages[-1].times) and known < pages[0].samples:
            pages.append(await self._page(pages[0].recording_id, known))
            known += len(pages[-1].times)
        first, turned = pages[-1], [page.orientations for page in pages if page.orientations is not None]
        return RecordingView(
            first.recording_id,
            first.dimension,
            first.operator,
            first.source,
            first.recording,
            first.samples,
            np.concatenate([page.times for page in pages]),
            np.concatenate([page.positions for page in pages]),
            np.concatenate([page.triggers for page in pages]),
            np.concatenate(turned) if turned else None,
        )

    async def _page(self, recording_id: str, after: int) -> RecordingView:
        (
            found,
            dimension,
            operator,
            source,
            is_open,
            samples,
            times,
            positions,
            triggers,
            turned,
        ) = await self.session.call(
            self.path, "GetRecording", RecordingId=to_server.string(recording_id), After=to_server.uint32(after)
        )
        return RecordingView(
            found,
            int(dimension),
            operator or "",
            source or "",
            bool(is_open),
            int(samples),
            np.asarray(times or (), dtype=np.float64),
            np.asarray(positions or (), dtype=np.float64).reshape(-1, int(dimension)),
            np.asarray(triggers or (), dtype=bool),
            np.asarray(turned, dtype=np.float64).reshape(-1, 4) if turned else None,
        )

    async def presses(self, recording_id: str = "") -> Presses:
        """Return the demonstrations of a recording, also while it goes on; no id: the open or the newest one."""
        ids, first, last, goes_on = await self.session.call(
            self.path, "ListDemonstrations", RecordingId=to_server.string(recording_id)
        )
        return Presses(tuple(ids or ()), tuple(map(int, first or ())), tuple(map(int, last or ())), bool(goes_on))

    async def demonstration(self, recording_id: str, demonstration_id: str) -> Demonstration:
        """Return one demonstration of a recording, once its press has ended."""
        [value] = await self.session.call(
            self.path,
            "GetDemonstration",
            RecordingId=to_server.string(recording_id),
            DemonstrationId=to_server.string(demonstration_id),
        )
        return to_server.demonstration_in(value)

    async def discard(self, recording_id: str, demonstration_id: str = "") -> int:
        """Forget one demonstration or, with no name, the whole recording; return how many are left."""
        [left] = await self.session.call(
            self.path,
            "DiscardRecording",
            RecordingId=to_server.string(recording_id),
            DemonstrationId=to_server.string(demonstration_id),
        )
        return int(left)

    async def learn(
        self,
        recording_id: str,
        skill_name: str,
        semantic_type: str,
        options: LearningOptions | None = None,
    ) -> Learned:
        """Learn a new version of a skill from a finished recording; comes back within about 1 s."""
        job_id, state, version, results, report = await self.session.call(
            self.path,
            "LearnFromRecording",
            RecordingId=to_server.string(recording_id),
            SkillName=to_server.string(skill_name),
            SemanticType=to_server.string(semantic_type),
            Options=to_server.structure(to_server.options_out(self.session.structure, options or LearningOptions())),
        )
        return Learned(
            job_id, state, int(version), tuple(code.name for code in results or ()), to_server.document(report)
        )

    async def press(self, pressed: bool) -> None:
        """Tell where the push button is, for samples that come without triggers."""
        await self.session.write(f"{self.path}/Trigger", ua.Variant(pressed, ua.VariantType.Boolean))

    async def state(self) -> RecorderState:
        """Return what the recorder's variables show now: at most a tenth of a second old."""
        names = ("Recording", "Trigger", "RecordingId", "Samples", "DemonstrationCount", "Ignored", "LastIgnored")
        values = await self.session.read(*(f"{self.path}/{name}" for name in names))
        recording, trigger, recording_id, samples, demonstrations, ignored, last_ignored = values
        return RecorderState(
            bool(recording),
            bool(trigger),
            recording_id or "",
            int(samples),
            int(demonstrations),
            int(ignored),
            last_ignored or "",
        )


def _doubles(values: Sequence[float] | Sequence[Sequence[float]] | Floats) -> ua.Variant:
    flat = np.asarray(values, dtype=np.float64).ravel().tolist()
    return ua.Variant(flat, ua.VariantType.Double, is_array=True)


def _booleans(values: Sequence[bool] | Bools) -> ua.Variant:
    return ua.Variant(np.asarray(values, dtype=bool).tolist(), ua.VariantType.Boolean, is_array=True)

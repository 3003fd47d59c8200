"""The methods of a workstation's recorder: samples come in, demonstrations go out, and a skill is learned from them.

All of it is memory: a restart of the server forgets recordings, a lost connection does not.
"""

import logging
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import numpy as np

from library.errors import NotAllowedInState, NotFound
from library.names import same_user
from library.values import check_text
from models.demonstration import Demonstration
from opcua_skill.configuration.settings import Limits
from opcua_skill.security.access import Role, caller
from opcua_skill.server.features.library import LibraryMethods
from opcua_skill.server.recording import (
    ALL_SAMPLES,
    ONE_APPEND,
    Bounds,
    InvalidSamples,
    LimitExceeded,
    Press,
    Recording,
)
from opcua_skill.stack.services.calls import Refused
from opcua_skill.wire.from_client import NEEDED, ReceivedDemonstrations, wire_demonstration
from opcua_skill.wire.refusals import Code, out_of_range, refusing

KEPT = 5
KEPT_SECONDS = 3600.0
LARGEST_ANSWER = 100_000
MAX_TEXT = 512

_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Kept:
    """A recording, the session that feeds it, and since when it is closed (monotonic s)."""

    recording: Recording
    session_id: str
    user: str
    closed_at: float = 0.0


@dataclass
class RecorderMethods:
    """Handlers of one workstation's recorder, and its recordings: the newest last."""

    workstation: str
    library: LibraryMethods
    limits: Limits
    is_connected: Callable[[str], bool]
    clock: Callable[[], float] = time.monotonic
    button: bool | None = None
    _kept: dict[str, _Kept] = field(default_factory=dict)

    @property
    def newest(self) -> Recording | None:
        """The recording that is open or, if none is, the one that was begun last."""
        return next(reversed(self._kept.values())).recording if self._kept else None

    @property
    def trigger(self) -> bool:
        """Where the push button is, as far as anybody has told."""
        newest = self.newest
        return bool(self.button) or (newest is not None and newest.is_open and newest.trigger)

    def forget_old(self) -> None:
        """Forget recordings that were closed an hour ago."""
        for name, kept in list(self._kept.items()):
            if not kept.recording.is_open and self.clock() - kept.closed_at >= KEPT_SECONDS:
                self._forget(name, "it was closed an hour ago")

    def session_closed(self, session_id: str) -> None:
        """Close the recording that this session was feeding; what was recorded so far stays."""
        for name, kept in self._kept.items():
            if kept.recording.is_open and kept.session_id == session_id:
                self._close(kept)
                _log.warning(
                    "recording %s on %s was closed: the session of %s ended", name, self.workstation, kept.user
                )

    async def press(self, value: Any) -> None:
        """Take the push button as somebody writes it, for samples that come without triggers."""
        if not isinstance(value, bool):
            raise Refused(Code.BadTypeMismatch, "Trigger is a Boolean")
        newest = self.newest
        if newest is None or not newest.is_open:
            raise Refused(Code.BadInvalidState, "nothing is being recorded: start a recording first")
        self.button = value

    @refusing(blame="Source", fields={"Operator": "Operator", "Source": "Source"})
    async def start_recording(self, dimension: int, operator: str, source: str) -> tuple[Any, ...]:
        """Begin a recording, which this session alone feeds; closed ones are kept until discarded or for an hour."""
        if dimension not in (2, 3):
            raise out_of_range("Dimension", f"Dimension is {dimension}: it has to be 2 or 3")
        check_text(operator, "Operator", MAX_TEXT)
        check_text(source, "Source", MAX_TEXT)
        self.forget_old()
        for kept in self._kept.values():
            if kept.recording.is_open and not self.is_connected(kept.session_id):
                self.session_closed(kept.session_id)
            if kept.recording.is_open:
                remedy = f"finish or discard recording {kept.recording.recording_id} first"
                raise NotAllowedInState(f"the recorder of {self.workstation}", f"recording for {kept.user}", remedy)
        while len(self._kept) >= KEPT:
            self._forget(self._oldest(caller().name), f"{KEPT} recordings are kept")
        now = datetime.now(UTC)
        name = f"{now:%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
        bounds = Bounds(self.limits.max_demonstrations, self.limits.max_points_per_demonstration)
        recording = Recording(name, dimension, operator or caller().name, source, now, bounds)
        self._kept[name] = _Kept(recording, caller().session_id, caller().name)
        self.button = None
        return (name,)

    @refusing(blame="RecordingId")
    async def append_samples(
        self,
        recording_id: str,
        times: list[float],
        positions: list[float],
        triggers: list[bool],
        orientations: list[float],
    ) -> tuple[Any, ...]:
        """Add samples, all or none: s, m, the push button (none: as Trigger says, or on), quaternions (or none)."""
        kept = self._find(recording_id)
        recording = kept.recording
        if not recording.is_open:
            raise NotAllowedInState(f"recording {recording_id}", "closed", "start another one")
        if kept.session_id != caller().session_id:
            raise NotAllowedInState(f"recording {recording_id}", f"fed by {kept.user}", "start one of your own")
        count = len(times)
        if max(count, len(positions) // 3, len(orientations) // 4) > ONE_APPEND:
            raise Refused(Code.BadRequestTooLarge, f"{count} samples were sent, {ONE_APPEND} are allowed in one append")
        if recording.samples + count > ALL_SAMPLES:
            reason = f"a recording holds {ALL_SAMPLES} samples: finish it and start another one"
            raise Refused(Code.BadRequestTooLarge, reason)
        try:
            recording.append(
                np.array(times, dtype=np.float64),
                np.array(positions, dtype=np.float64),
                np.array(triggers, dtype=np.bool_) if triggers else None,
                np.array(orientations, dtype=np.float64),
                True if self.button is None else self.button,
            )
        except InvalidSamples as wrong:
            raise out_of_range(wrong.argument, str(wrong)) from wrong
        except LimitExceeded as wrong:
            raise Refused(Code.BadRequestTooLarge, str(wrong)) from wrong
        self._make_room(kept.user)
        return (recording.samples, len(recording.all_presses))

    @refusing(blame="RecordingId")
    async def finish_recording(self, recording_id: str) -> tuple[Any, ...]:
        """End a recording and return its demonstrations; above 100,000 samples: only their names."""
        kept = self._find(recording_id)
        if kept.recording.is_open:
            self._check_owner(kept)
        self._close(kept)
        recording = kept.recording
        total = sum(press.end - press.first for press in recording.presses)
        return ([_on_the_wire(recording, press, heads_only=total > LARGEST_ANSWER) for press in recording.presses],)

    @refusing(blame="After")
    async def get_recording(self, recording_id: str, after: int) -> tuple[Any, ...]:
        """Return what a recording is, how many samples it has, and up to 20,000 of those after the first After ones."""
        recording = self._find_or_newest(recording_id)
        if after > recording.samples:
            raise out_of_range("After", f"After is {after}, the recording has {recording.samples} samples")
        cut = recording.after(after)
        return (
            recording.recording_id,
            recording.dimension,
            recording.operator,
            recording.source,
            recording.is_open,
            recording.samples,
            cut.times.tolist(),
            cut.positions.ravel().tolist(),
            cut.triggers.tolist(),
            [] if cut.orientations is None else cut.orientations.ravel().tolist(),
        )

    @refusing(blame="RecordingId")
    async def list_demonstrations(self, recording_id: str) -> tuple[Any, ...]:
        """Return the demonstrations of a recording by the samples they begin and end with; the last may still go on."""
        recording = self._find_or_newest(recording_id)
        presses = recording.all_presses
        return (
            [press.demonstration_id for press in presses],
            [press.first for press in presses],
            [press.end - 1 for press in presses],
            recording.going_on is not None,
        )

    @refusing(blame="DemonstrationId")
    async def get_demonstration(self, recording_id: str, demonstration_id: str) -> tuple[Any, ...]:
        """Return one demonstration of a recording, once its press has ended."""
        recording = self._find(recording_id).recording
        return (_on_the_wire(recording, self._ended_press(recording, demonstration_id)),)

    @refusing(blame="DemonstrationId")
    async def discard_recording(self, recording_id: str, demonstration_id: str) -> tuple[Any, ...]:
        """Forget one demonstration, or with no name the whole recording; return how many are left."""
        kept = self._find(recording_id)
        self._check_owner(kept)
        recording = kept.recording
        if not demonstration_id:
            self._forget(recording_id, f"{caller().name} discarded it")
            return (0,)
        recording.discard(self._ended_press(recording, demonstration_id).demonstration_id)
        return (len(recording.presses),)

    @refusing(blame="SkillName", fields={"semantic_type": "SemanticType"})
    async def learn_from_recording(
        self, recording_id: str, skill_name: str, semantic_type: str, options: Any
    ) -> tuple[Any, ...]:
        """Learn a new version of a skill from a finished recording."""
        kept = self._find(recording_id)
        self._check_owner(kept)
        recording = kept.recording
        if recording.is_open:
            raise NotAllowedInState(f"recording {recording_id}", "still open", "finish it first")
        shown = tuple(recording.demonstration(press) for press in recording.presses)
        if len(shown) < NEEDED:
            raise out_of_range("RecordingId", f"{NEEDED} demonstrations are needed, the recording has {len(shown)}")
        received = ReceivedDemonstrations(shown, ("",) * len(shown), tuple(one.demonstration_id for one in shown))
        return await self.library.learn_received(skill_name, semantic_type, received, options, (kept.user,))

    @staticmethod
    def _check_owner(kept: _Kept) -> None:
        """Refuse whoever is neither who began a recording nor an engineer or administrator."""
        who = caller()
        if same_user(who.name) != same_user(kept.user) and who.role not in Role.ENGINEER.and_above:
            name = kept.recording.recording_id
            raise Refused(Code.BadUserAccessDenied, f"recording {name} belongs to {kept.user}: ask them or an engineer")

    def _oldest(self, user: str) -> str:
        """Return which recording has to go when ``user`` needs room: the oldest closed one, rather one of their own."""
        closed = [name for name, kept in self._kept.items() if not kept.recording.is_open]
        own = [name for name in closed if same_user(self._kept[name].user) == same_user(user)]
        return next(iter([*own, *closed, *self._kept]))

    def _find(self, recording_id: str) -> _Kept:
        self.forget_old()
        kept = self._kept.get(recording_id)
        if kept is None:
            raise NotFound("recording", recording_id)
        return kept

    def _find_or_newest(self, recording_id: str) -> Recording:
        if recording_id:
            return self._find(recording_id).recording
        self.forget_old()
        newest = self.newest
        if newest is None:
            raise Refused(Code.BadNotFound, f"nothing is recorded on {self.workstation}: start a recording")
        return newest

    @staticmethod
    def _ended_press(recording: Recording, demonstration_id: str) -> Press:
        going_on = recording.going_on
        if going_on is not None and going_on.demonstration_id == demonstration_id:
            raise NotAllowedInState(demonstration_id, "still being shown", "release the push button first")
        for press in recording.presses:
            if press.demonstration_id == demonstration_id:
                return press
        raise NotFound("demonstration", demonstration_id)

    def _close(self, kept: _Kept) -> None:
        if kept.recording.is_open:
            kept.recording.close()
            kept.closed_at = self.clock()
            self.button = None

    def _make_room(self, user: str) -> None:
        """Forget closed recordings, rather those of ``user``, while all together hold too many samples."""
        while sum(one.recording.samples for one in self._kept.values()) > ALL_SAMPLES:
            self._forget(self._oldest(user), "room was needed for a newer one")

    def _forget(self, recording_id: str, because: str) -> None:
        gone = self._kept.pop(recording_id)
        if gone.recording.is_open:
            self.button = None
        _log.info("recording %s on %s is forgotten: %s", recording_id, self.workstation, because)


def _on_the_wire(recording: Recording, press: Press, *, heads_only: bool = False) -> Any:
    """Return a demonstration as it goes over the wire; ``heads_only`` leaves its samples out."""
    one = recording.demonstration(press)
    return wire_demonstration(_head(one) if heads_only else one)


def _head(one: Demonstration) -> Demonstration:
    return Demonstration(
        one.demonstration_id,
        np.zeros(0),
        np.zeros((0, one.dimension)),
        np.zeros(0, dtype=np.bool_),
        one.operator,
        one.source,
        one.recorded_at,
    )

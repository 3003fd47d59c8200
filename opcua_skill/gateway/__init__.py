"""From a tracker to a workstation's recorder: files replayed at their own speed, or lines of text that come by UDP.

What a tracker sends is never mended: a sample is taken as it is or not at all, and what was not taken is counted.
"""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from opcua_skill.client import Recorder, Refused
from opcua_skill.gateway.lines import FORMAT, Intake, Line, Losses, parse
from opcua_skill.gateway.sources import STOPPED, ReplaySource, Source, SourceFault, UdpSource
from opcua_skill.gateway.trackers import tracker_at

__all__ = [
    "FORMAT",
    "STOPPED",
    "Ended",
    "Intake",
    "Line",
    "Losses",
    "Progress",
    "ReplaySource",
    "Source",
    "SourceFault",
    "UdpSource",
    "parse",
    "pass_on",
    "tracker_at",
]


@dataclass(frozen=True, slots=True)
class Progress:
    """How far a recording has come."""

    samples: int
    demonstrations: int
    trigger: bool
    losses: Losses


@dataclass(frozen=True, slots=True)
class Ended:
    """A recording that has come to its end, not finished yet, and why.

    ``pressed``: the button was still down, so that the last demonstration may be cut short; ``has_button``: it was seen
    released at some time, so that the tracker does have one.
    """

    recording_id: str
    samples: int
    demonstrations: int
    why: str
    pressed: bool
    has_button: bool
    losses: Losses


async def pass_on(
    recorder: Recorder,
    source: Source,
    *,
    operator: str = "",
    stop: asyncio.Event,
    on_start: Callable[[str], None] = lambda _: None,
    on_progress: Callable[[Progress], None] = lambda _: None,
) -> Ended:
    """Record what a source gives until it ends, ``stop`` is set or the server takes no more; the recording stays open.

    Raises SourceFault if nothing came at all, and what the client raises when the server cannot be reached.
    """
    dimension = await _begun(source, stop)
    recording_id = await recorder.start(dimension, operator, source.name)
    on_start(recording_id)
    samples, demonstrations, pressed, released, why = 0, 0, False, False, ""
    while (batch := await source.next(stop)) is not None:
        try:
            told = await recorder.append(recording_id, batch.times, batch.positions, batch.triggers, batch.orientations)
        except Refused as refusal:
            # Somebody who finished the recording meanwhile has decided what its last demonstration is.
            why, pressed = refusal.reason, pressed and refusal.status != "BadInvalidState"
            break
        samples, demonstrations, pressed = told.samples, told.demonstrations, bool(batch.triggers[-1])
        released = released or not batch.triggers.all()
        on_progress(Progress(samples, demonstrations, pressed, source.losses))
    return Ended(recording_id, samples, demonstrations, why or source.ended, pressed, released, source.losses)


async def _begun(source: Source, stop: asyncio.Event) -> int:
    """Return the dimension, or raise SourceFault if asked to stop before anything came."""
    beginning, stopping = asyncio.ensure_future(source.begin()), asyncio.ensure_future(stop.wait())
    try:
        await asyncio.wait((beginning, stopping), return_when=asyncio.FIRST_COMPLETED)
        if beginning.done():
            return beginning.result()
        raise SourceFault("stopped before anything came")
    finally:
        for one in (beginning, stopping):
            one.cancel()
        await asyncio.gather(beginning, stopping, return_exceptions=True)

"""Trackers of makers' own protocols, brought by installed distributions: entry points of ``opcua_skill.trackers``."""

from contextlib import AbstractAsyncContextManager
from importlib.metadata import entry_points
from typing import Protocol

from opcua_skill.gateway.sources import Source, SourceFault

DOOR = "opcua_skill.trackers"


class Tracker(Protocol):
    """What an entry point names."""

    def __call__(self, address: str) -> AbstractAsyncContextManager[Source]:
        """Return a context that is connected to the tracker at an address and yields its samples.

        Raises SourceFault where there is nobody at that address.
        """
        ...


def tracker_names() -> tuple[str, ...]:
    """Return which trackers are installed."""
    return tuple(sorted({entry.name for entry in entry_points(group=DOOR)}))


def tracker_at(named: str) -> AbstractAsyncContextManager[Source]:
    """Return the source of ``NAME`` or ``NAME:ADDRESS``. Raises SourceFault if no such tracker is installed."""
    name, _, address = named.partition(":")
    for entry in entry_points(group=DOOR, name=name):
        found: Tracker = entry.load()
        return found(address)
    there = ", ".join(tracker_names()) or "none"
    raise SourceFault(f"no tracker is called {name!r}: installed are {there}; one that sends by UDP needs --udp only")

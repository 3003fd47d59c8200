"""Several servers on one library: whose workstation is whose, and what the others have changed."""

import asyncio
import logging
import os
import socket
from collections.abc import Awaitable, Callable, Sequence
from typing import Protocol

from library.description import SkillDescription
from library.errors import LibraryError
from library.queries.leases import Lease, Server
from library.queries.news import News
from library.store import SkillLibrary
from opcua_skill.configuration.settings import Settings
from opcua_skill.server.health import Fault, FaultKind

LEASE_SECONDS = 30.0
"""s for which a workstation is kept for a server that is not heard of: longer than a database needs to start anew."""
RENEW_EVERY = 5.0

_log = logging.getLogger(__name__)


class Events(Protocol):
    """Where changes are told to this server's own clients."""

    async def version_changed(self, description: SkillDescription, actor: str, comment: str) -> None:
        """A version was stored or decided on."""
        ...

    async def deployment_changed(
        self, description: SkillDescription, workstation: str, there: bool, actor: str
    ) -> None:
        """A version was deployed or withdrawn."""
        ...


def server_of(settings: Settings, installation: str) -> Server:
    """Return the name by which a server gets its workstations back after a crash; a copy of its data has another."""
    return Server(f"{installation} {socket.gethostname()} {os.fspath(settings.data.resolve())}", settings.endpoint)


class Sharing:
    """Keeps this server's leases, hears what other servers change, and tells it to this one's clients.

    ``look_anew`` brings the nodes of a workstation in step with the library; ``show`` is given every lease there is.
    """

    def __init__(
        self,
        library: SkillLibrary,
        workstations: Sequence[str],
        events: Events,
        look_anew: Callable[[str], Awaitable[None]],
        show: Callable[[Sequence[Lease]], Awaitable[None]],
    ) -> None:
        self._library = library
        self._workstations = tuple(workstations)
        self._events = events
        self._look_anew = look_anew
        self._show = show
        self._lost: tuple[Lease, ...] = ()
        self._heard: asyncio.Queue[News | None] = asyncio.Queue()
        self._tasks: list[asyncio.Task[None]] = []

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The workstations that another server has taken, in words."""
        return tuple(
            Fault(FaultKind.SERVED_ELSEWHERE, f"{one.workstation} is served by {one.endpoint} by now")
            for one in self._lost
        )

    def start(self) -> None:
        """Begin to keep and to listen, where the library is shared."""
        if self._library.shared:
            self._library.listen(self._heard.put_nowait)
            self._tasks = [
                asyncio.create_task(self._keep(), name="keep leases"),
                asyncio.create_task(self._hear(), name="hear other servers"),
            ]

    async def stop(self) -> None:
        """Keep and hear no more, and let others have the workstations."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        try:
            await self._library.give_back_leases()
        except LibraryError as unusable:
            _log.warning("the workstations are given back by time alone: %s", unusable)

    async def _keep(self) -> None:
        while True:
            try:
                self._lost = tuple(await self._library.renew_leases(LEASE_SECONDS))
                await self._show(await self._library.leases())
            except LibraryError as unusable:  # told by the health of the library
                _log.warning("the leases of the workstations are not renewed: %s", unusable)
            await asyncio.sleep(RENEW_EVERY)

    async def _hear(self) -> None:
        while True:
            news = await self._heard.get()
            try:
                await self._tell(news)
            except LibraryError as unusable:
                _log.warning("what another server changed is not shown yet: %s", unusable)
            except Exception:
                _log.exception("telling what another server changed failed")

    async def _tell(self, news: News | None) -> None:
        if news is None:  # after a new connection: what was said in between is to be found in the library
            for workstation in self._workstations:
                await self._look_anew(workstation)
        if news is None or news.kind == "leases":
            await self._show(await self._library.leases())
            return
        description = await self._library.description(news.skill_name, news.version)
        if news.kind == "version":
            decided = description.decisions[-1].comment if description.decisions else ""
            await self._events.version_changed(description, news.actor, decided)
        else:
            await self._events.deployment_changed(description, news.workstation, news.kind == "deployed", news.actor)

"""Processes that compute: learning and planning never run in the server's own. A dead worker is a named failure."""

import asyncio
import gc
import itertools
import logging
import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing import connection, forkserver, resource_tracker, util
from typing import Any, NoReturn, TypeVar

PREPARED = ("opcua_skill.jobs.worker_tasks", "models.learning", "scipy.interpolate", "scipy.ndimage")
"""What workers find imported: the server itself does without most of it.

What only the paper's preset and the comparison with it use (scikit-learn) costs as much again: a worker imports that
when it first compares.
"""
# A socket's path has room for 103 characters; multiprocessing puts it into `pymp-xxxxxxxx/listener-xxxxxxxx`.
LONGEST_TEMPORARY_FOLDER = 103 - 32

_log = logging.getLogger(__name__)
_progress: Any = None
Result = TypeVar("Result")


class WorkerDied(RuntimeError):
    """The process that computed has ended without an answer."""

    def __init__(self, what: str) -> None:
        super().__init__(f"the worker process died while it was {what}; a new one is started, try again")


class WorkerTimeout(RuntimeError):
    """A computation took longer than it may."""

    def __init__(self, what: str, seconds: float) -> None:
        super().__init__(f"{what} took longer than {seconds:g} s and was ended")


def _begin(progress: Any) -> None:
    """Prepare a worker: one thread for numerics, Ctrl-C is the parent's business, no life after the parent's death."""
    global _progress
    _progress = progress
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    parent = multiprocessing.parent_process()
    if parent is not None:
        sentinel = parent.sentinel
        threading.Thread(target=lambda: (connection.wait([sentinel]), os._exit(1)), daemon=True).start()


def report_progress(fraction: float, _step: str = "") -> None:
    """Called inside a worker: say how far the computation has come, 0..1."""
    if _progress is not None:
        _progress.value = fraction


def prepare(beyond: Sequence[str] = ()) -> None:
    """Fork the process that workers are forked from, with all that this one has imported; it imports ``beyond`` too.

    For a process that is going to serve, before it has a thread, a loop or an open file: a fork copies none of them
    well. Else that process is started when a worker is first wanted, and imports for itself.
    """
    if threading.active_count() > 1 or _context().get_start_method() != "forkserver":
        return
    resource_tracker.ensure_running()
    started = util.spawnv_passfds
    util.spawnv_passfds = partial(_forked, beyond)
    try:
        forkserver.ensure_running()
    finally:
        util.spawnv_passfds = started


def _forked(beyond: Sequence[str], _path: Any, _arguments: Any, kept: Sequence[int]) -> int:
    """Do what `multiprocessing.util.spawnv_passfds` does for the process that forks workers, but keep what is here."""
    pid = os.fork()
    if pid == 0:
        _fork_workers(kept, beyond)
    return pid


def _fork_workers(kept: Sequence[int], beyond: Sequence[str]) -> NoReturn:
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as its main function does, but from the first import on
        borders = [2, *sorted(kept), os.sysconf("SC_OPEN_MAX")]
        for before, after in itertools.pairwise(borders):
            os.closerange(before + 1, after)
        forkserver._forkserver._lock = threading.Lock()  # pyright: ignore[reportAttributeAccessIssue]
        gc.freeze()
        gc.enable()
        forkserver.main(*kept, preload=list(beyond))
    except SystemExit:
        code = 0
    finally:
        os._exit(code)


def _context() -> Any:
    """Return how workers start: forked from a process that has imported the numerics, so in milliseconds.

    Where there is no such thing (Windows), or no room for the path of its socket, they are spawned, each importing for
    itself.
    """
    short = len(tempfile.gettempdir()) <= LONGEST_TEMPORARY_FOLDER
    if "forkserver" not in multiprocessing.get_all_start_methods() or not short:
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(list(PREPARED))
    return context


class Workers:
    """A fixed number of worker processes, each with one computation at a time."""

    def __init__(self, number: int, name: str) -> None:
        self._context = _context()
        self._name = name
        self._progress = [self._context.Value("d", 0.0) for _ in range(number)]
        self._pools = [self._new_pool(index) for index in range(number)]
        self._idle: asyncio.Queue[int] = asyncio.Queue()
        for index in range(number):
            self._idle.put_nowait(index)

    def _new_pool(self, index: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, mp_context=self._context, initializer=_begin, initargs=(self._progress[index],))

    async def warm_up(self, function: Callable[[], Any]) -> None:
        """Start every process and let it import what ``function`` needs, so that the first computation does not pay."""
        for pool in self._pools:
            await asyncio.wrap_future(await asyncio.to_thread(pool.submit, function))

    async def run(
        self,
        what: str,
        function: Callable[..., Result],
        *arguments: Any,
        seconds: float,
        on_progress: Callable[[float], None] | None = None,
    ) -> Result:
        """Return what the function returns, computed in a worker; its exceptions pass through.

        Raises WorkerDied or WorkerTimeout. Cancelling ends the computation too.
        """
        index = await self._idle.get()
        pool, progress = self._pools[index], self._progress[index]
        progress.value = 0.0
        try:
            # The first submission starts the process and waits for it, seconds on a busy machine: never on the loop.
            # Large arguments are pickled by the executor's own thread.
            future = asyncio.wrap_future(await asyncio.to_thread(pool.submit, function, *arguments))
            async with asyncio.timeout(seconds):
                while True:
                    done, _ = await asyncio.wait({future}, timeout=0.2 if on_progress else None)
                    if done:
                        return future.result()
                    if on_progress:
                        on_progress(progress.value)
        except BrokenProcessPool:
            self._replace(index)
            raise WorkerDied(what) from None
        except TimeoutError:
            self._replace(index)
            raise WorkerTimeout(what, seconds) from None
        except asyncio.CancelledError:
            self._replace(index)
            raise
        finally:
            self._idle.put_nowait(index)

    def _replace(self, index: int) -> None:
        _log.warning("%s worker %d is replaced", self._name, index)
        self._end(self._pools[index])
        self._pools[index] = self._new_pool(index)

    @staticmethod
    def _end(pool: ProcessPoolExecutor) -> None:
        for process in list((pool._processes or {}).values()):
            process.kill()
        pool.shutdown(wait=False, cancel_futures=True)

    def close(self) -> None:
        """End every process, whatever it does."""
        for pool in self._pools:
            self._end(pool)

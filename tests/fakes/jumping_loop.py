"""An event loop for models of a day: nobody waits in it, and the same choices always give the same order of events.

Its clock jumps to the next thing to do, and what would be done in a thread is done between two turns of the loop.
"""

import asyncio
import selectors
from collections.abc import Callable
from typing import Any


class _Jumping(selectors.DefaultSelector):
    """Waits for nothing: time passes instead."""

    now = 0.0

    def select(self, timeout: float | None = None) -> Any:
        if timeout is None:
            raise RuntimeError("everything waits, and nothing is there that could go on")
        self.now += max(0.0, timeout)
        return super().select(0.0)


class JumpingLoop(asyncio.SelectorEventLoop):
    """``turns`` is how many turns pass from when a thread's work is done until its result is there."""

    def __init__(self) -> None:
        self._jumping = _Jumping()
        self.turns = 0
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now

    def run_in_executor(self, executor: Any, func: Callable[..., Any], *args: Any) -> Any:
        done = self.create_future()
        self.call_soon(self._do, done, func, args)
        return done

    def _do(self, done: "asyncio.Future[Any]", func: Callable[..., Any], args: tuple[Any, ...]) -> None:
        try:
            answer, fault = func(*args), None
        except Exception as raised:
            answer, fault = None, raised
        self.call_soon(self._answer, done, answer, fault, self.turns)

    def _answer(self, done: "asyncio.Future[Any]", answer: Any, fault: Exception | None, turns: int) -> None:
        if turns > 0:
            self.call_soon(self._answer, done, answer, fault, turns - 1)
        elif not done.done():
            if fault is None:
                done.set_result(answer)
            else:
                done.set_exception(fault)

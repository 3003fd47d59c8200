"""Who asked for which motion, who took it back, and whether every motion that began was wanted when it began."""

import time
from dataclasses import dataclass, field
from typing import Literal

Kind = Literal["run", "home", "resume", "pendant"]


@dataclass
class Call:
    """Something asked for: when, and when the answer came. ``good`` is None until then."""

    what: str
    job_id: str = ""
    started: int = field(default_factory=time.monotonic_ns)
    ended: int = 0
    good: bool | None = None

    def done(self, good: bool) -> None:
        self.ended, self.good = time.monotonic_ns(), good


@dataclass(frozen=True)
class Beginning:
    """A motion that began; ``handed``: when the arm was given it, which may take a while to begin."""

    at: int
    kind: str
    digest: str
    handed: int = 0


@dataclass
class Ledger:
    """Everything that was asked, everything that began. Times are of the machine's monotonic clock, in ns."""

    calls: list[Call] = field(default_factory=list)
    began: list[Beginning] = field(default_factory=list)
    jobs: dict[str, str] = field(default_factory=dict)
    holds: list[Call] = field(default_factory=list)

    def call(self, what: str, job_id: str = "") -> Call:
        made = Call(what, job_id)
        self.calls.append(made)
        return made

    def hold(self, what: str) -> None:
        """Note something that has to hold the queue and has been noticed by now."""
        noticed = Call(what)
        noticed.done(good=True)
        self.holds.append(noticed)

    def of(self, what: str) -> list[Call]:
        return [one for one in self.calls if one.what == what]

    def check(self, began: Beginning) -> None:
        """Fail unless a motion was asked for, and nobody has taken that back."""
        {"run": self._check_run, "home": self._check_home, "resume": self._check_resume, "pendant": lambda _: None}[
            began.kind
        ](began)

    def _check_run(self, began: Beginning) -> None:
        job_id = self.jobs.get(began.digest, "")
        asked = [one for one in self.of("execute") if one.started < began.at and one.job_id in ("", job_id)]
        assert asked, f"nobody asked for {began}"
        before = [one for one in self.began if one.kind == "run" and one.digest == began.digest and one.at < began.at]
        assert not before, f"{job_id} began twice"
        taken_back = [one for one in self.of("abort") if one.job_id == job_id and one.good and 0 < one.ended < began.at]
        assert not (taken_back and job_id), f"{job_id} began although it was aborted: {taken_back}"
        self._check_released(began)

    def _check_released(self, began: Beginning) -> None:
        held = [one for one in [*self.holds, *self._holding_calls()] if 0 < one.ended < began.at]
        if not held:
            return
        last = max(held, key=lambda one: one.ended)
        if last.what == "hold" and began.handed and last.started > began.handed:
            return  # what runs goes on, and it was under way
        released = [
            one for one in self.of("release")
            if one.started < began.at and one.good is not False and (one.ended == 0 or one.ended > last.started)
        ]  # fmt: skip
        assert released, f"{began} although the queue was held by {last} and nobody released it"

    def _holding_calls(self) -> list[Call]:
        return [one for one in self.calls if one.good and one.what in {"stop", "hold", "abort of what runs"}]

    def _check_home(self, began: Beginning) -> None:
        asked = [one for one in self.of("go home") if one.started < began.at]
        before = [one for one in self.began if one.kind == "home" and one.at < began.at]
        assert len(asked) > len(before), f"{began}: the arm went home {len(before) + 1} times, asked {len(asked)} times"
        stopped = [
            one for one in self.of("stop") if one.good and asked[-1].started < one.started and one.ended < began.at
        ]
        assert not stopped, f"{began} although it was stopped after it was asked for"

    def _check_resume(self, began: Beginning) -> None:
        asked = [one for one in self.of("resume") if one.started < began.at and one.good is not False]
        before = [one for one in self.began if one.kind == "resume" and one.at < began.at]
        assert len(asked) > len(before), f"{began}: it went on more often than anybody asked"
        job_id = self.jobs.get(began.digest, "")
        aborts = [one for one in self.of("abort") if one.job_id == job_id and one.good and 0 < one.ended < began.at]
        assert not (aborts and job_id), f"{job_id} went on although it was aborted"

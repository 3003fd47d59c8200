"""What learning and regression cost: against the naive stack and gmr, and how time and memory grow."""

import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.learning_rows import Peers, Row, plain, row
from models.demonstration import Demonstration
from models.learning import LearningOptions, learn
from models.mixture.gmm import priors
from models.synthetic import simulated_people

ROOT = Path(__file__).resolve().parents[1]
ROUNDS = 3


def speed(peers: Peers) -> Iterator[Row]:
    """Give the rows of whole learnings against the naive stack: the quickest of three rounds of each.

    A neighbour on the same machine makes either of them half as slow again for seconds or minutes. In a round the peer
    learns once, and we twenty times before it and twenty times after it, of which the median counts.
    """
    for rate, goal in ((150.0, 80), (1000.0, 400)):
        people, _ = simulated_people(20, 0, rate=rate)
        learn(people)
        rounds: list[tuple[float, float]] = []
        for _ in range(ROUNDS):
            before = _learning_times(people)
            _, theirs = peers.answers([("naive", plain(people))])[0]
            rounds.append((float(np.median(before + _learning_times(people))), theirs))
        ours, theirs = np.min(rounds, axis=0).tolist()
        count = int(np.mean([len(one.times) for one in people]))
        yield row(
            f"20 x {count} points, s",
            ours,
            f">= {goal} times faster",
            theirs >= goal * ours,
            "naive stack",
            theirs,
            40 * ROUNDS,
        )


def _learning_times(people: list[Demonstration]) -> list[float]:
    """Return the processor seconds of twenty learnings."""
    times: list[float] = []
    for _ in range(20):
        began = time.process_time()
        learn(people, compare=False)
        times.append(time.process_time() - began)
    return times


def regression(peers: Peers) -> Iterator[Row]:
    motion = learn(simulated_people(8, 0)[0], options=LearningOptions(clock="path")).motion
    steps = np.linspace(0.0, 1.0, 1000)
    times: list[float] = []
    for _ in range(50):
        began = time.process_time()
        motion.at_phases(steps)
        times.append(time.process_time() - began)
    columns = [0, 2, 3]
    model = (priors(motion.covariances), motion.means[:, columns], motion.covariances[:, columns][:, :, columns])
    theirs, _ = peers.answers([("gmr", model)])[0]
    theirs = theirs if isinstance(theirs, float) else float("nan")
    yield row(
        "regression with covariance, 1000 steps, s",
        min(times),
        ">= 1000 times faster",
        theirs >= 1000 * min(times),
        "gmr",
        theirs,
        50,
    )


def scaling() -> Iterator[Row]:
    """Cost linear in points and in demonstrations up to 200 x 100,000, memory below 1 GiB there: in a process of its
    own.
    """
    program = "from benchmarks.learning_cost import big; print(*big())"
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    small, large, gigabytes = (float(word) for word in done.stdout.split())
    growth = large / small
    yield row("200 x 100,000 points against 20 x 100,000: times as long", growth, "<= 12", growth <= 12)
    yield row("200 x 100,000 points: memory beyond the recordings, GiB", gigabytes, "< 1", gigabytes < 1)


def big() -> tuple[float, float, float]:
    """Return the processor seconds for 20 and for 200 demonstrations of 100,000 points, and the GiB needed beyond the
    recordings.
    """
    people, _ = simulated_people(20, 0, rate=10_000.0)
    long = [
        Demonstration(f"{i}-{one.demonstration_id}", one.times, one.points, one.triggers)
        for i in range(10)
        for one in people
    ]
    began = time.process_time()
    learn(people)
    small = time.process_time() - began
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    learn(long)
    large = time.process_time() - began
    return small, large, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 2**20

"""How much one peer may have written down: so much at once, then so much a second; what is beyond is counted."""

import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass

MOST_PEERS = 10_000


@dataclass(slots=True)
class _Purse:
    left: float
    at: float
    beyond: int = 0


class Budget:
    """``burst`` entries at once for each peer, then ``rate`` a second."""

    def __init__(self, burst: float, rate: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._burst, self._rate, self._clock = burst, rate, clock
        self._purses: OrderedDict[Hashable, _Purse] = OrderedDict()

    def admits(self, peer: Hashable, cost: float = 1.0) -> bool:
        """Return whether one more entry of this size fits; one that does not is counted."""
        now = self._clock()
        purse = self._purses.pop(peer, None) or _Purse(self._burst, now)
        purse.left, purse.at = min(self._burst, purse.left + (now - purse.at) * self._rate), now
        self._purses[peer] = purse
        if len(self._purses) > MOST_PEERS:
            self._purses.popitem(last=False)
        if purse.left < cost:
            purse.beyond += 1
            return False
        purse.left -= cost
        return True

    def take_beyond(self) -> dict[Hashable, int]:
        """Return how many entries of each peer did not fit since this was asked last."""
        found = {peer: purse.beyond for peer, purse in self._purses.items() if purse.beyond}
        for peer in found:
            self._purses[peer].beyond = 0
        return found

"""Names of jobs."""

import secrets
import time

ALPHABET = "0123456789abcdefghjkmnpqrstvwxyz"
"""Digits and letters that nobody takes for one another: no i, l, o, u."""
EPOCH = 1_577_836_800.0
"""2020-01-01, s since 1970: what job ids count from."""


def new_job_id(kind: str) -> str:
    """Return a short id that sorts by time (in tenths of a second) and that two servers do not make alike."""
    instant = round((time.time() - EPOCH) * 10)
    return f"{kind}-{_written(instant, 7)}-{_written(secrets.randbits(25), 5)}"


def _written(number: int, digits: int) -> str:
    return "".join(ALPHABET[number >> 5 * place & 31] for place in reversed(range(digits)))

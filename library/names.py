"""Names in one form: what looks the same is the same, and people are known in every case their name is typed."""

import unicodedata
from collections.abc import Iterable


def normal(name: str) -> str:
    """Return a name in the normal form (NFC) in which names are kept: what looks the same is the same."""
    return unicodedata.normalize("NFC", name)


def same_user(name: str) -> str:
    """Return what is equal for names of one user, however they are typed: NFC, without regard to case."""
    return normal(normal(name).casefold())


def named(known: Iterable[str], name: str) -> str | None:
    """Return which of the names of users is meant; None if none is.

    One written exactly so comes first. Where two differ in form or case alone, as older libraries may hold them,
    nothing else names either: never is one taken for the other.
    """
    same = [one for one in known if same_user(one) == same_user(name)]
    if name in same:
        return name
    return same[0] if len(same) == 1 else None


def doubles(known: Iterable[str]) -> list[tuple[str, ...]]:
    """Return the names of users that differ in form or case alone."""
    groups: dict[str, list[str]] = {}
    for one in known:
        groups.setdefault(same_user(one), []).append(one)
    return [tuple(group) for group in groups.values() if len(group) > 1]

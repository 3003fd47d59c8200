"""What is said to people, in their language: one gettext catalogue a language in ``locale/``, and no line of code."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from babel import Locale, UnknownLocaleError
from babel.core import negotiate_locale

from opcua_skill.messages.catalogue import Catalogue, Said

ENGLISH = "en"
LOCALE = Path(__file__).parent / "locale"

__all__ = ["ENGLISH", "Catalogue", "Said", "catalogue_of", "languages", "name_of", "negotiated", "read_all", "said"]


@cache
def languages() -> tuple[str, ...]:
    """Return the languages there are catalogues for, as RFC 3066 tags: English first, which needs none."""
    return (ENGLISH, *sorted(file.stem for file in LOCALE.glob("*.po")))


@cache
def catalogue_of(language: str) -> Catalogue:
    """Return the catalogue of a language; that of a language there is none for says everything in English."""
    if language == ENGLISH or language not in languages():
        return Catalogue(ENGLISH, {})
    return Catalogue.read(LOCALE / f"{language}.po")


def read_all() -> None:
    """Read every catalogue, which takes some 0.1 s each, so that nobody waits for it later."""
    for language in languages():
        catalogue_of(language)


def negotiated(wanted: Sequence[str]) -> str:
    """Return the first language of ``wanted``, RFC 3066 tags, that there is; ``de-AT`` is served by ``de``."""
    found = negotiate_locale([one.strip() for one in wanted if one.strip()], languages(), sep="-") or ENGLISH
    return next((one for one in languages() if one.lower() == found.lower()), ENGLISH)


def said(language: str, sentence: str) -> str:
    """Return a sentence of ours in a language; English where its catalogue does not know it."""
    return catalogue_of(language).say(sentence).words


def name_of(language: str) -> str:
    """Return what a language is called by those who speak it."""
    try:
        return (Locale.parse(language, sep="-").get_display_name() or language).capitalize()
    except (UnknownLocaleError, ValueError):
        return language

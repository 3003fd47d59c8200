"""In which languages the server speaks, and its texts said in the one a session asked for (OPC 10000-4, 5.4)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from asyncua import ua

ENGLISH = "en"


def _english(_: Sequence[str]) -> str:
    return ENGLISH


def _as_it_is(_: str, text: str) -> str:
    return text


@dataclass(frozen=True, slots=True)
class Languages:
    """``known`` are LocaleIds, ``choose`` picks one by what a client wants most, ``say`` says an English text in it."""

    known: tuple[str, ...] = (ENGLISH,)
    choose: Callable[[Sequence[str]], str] = _english
    say: Callable[[str, str], str] = _as_it_is

    def said(self, language: str, value: ua.Variant) -> ua.Variant:
        """Return a value with its LocalizedTexts in a language; what has no translation stays English, and says so."""
        if language == ENGLISH or value.VariantType != ua.VariantType.LocalizedText:
            return value
        texts: Any = value.Value
        if isinstance(texts, list):
            return ua.Variant([self._said(language, one) for one in texts], value.VariantType)
        return ua.Variant(self._said(language, texts), value.VariantType)

    def _said(self, language: str, text: Any) -> Any:
        if text is None or not text.Text or text.Locale not in (None, "", ENGLISH):
            return text
        words = self.say(language, text.Text)
        return text if words == text.Text else ua.LocalizedText(words, language)

"""The server's sentences in German: recognised by how they are made, so that English stays the one truth on the wire.

A pattern has holes. ``{n}``, ``{n2}`` … are numbers, ``{t}``, ``{t2}`` … sentences or parts of one that are said in
German in their turn, any other hole is a name, which stays as it is. Sentences that no pattern knows stay English:
better read than lost.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from opcua_skill.panel.translation.german import GERMAN
from opcua_skill.panel.translation.sentences.files import FILES
from opcua_skill.panel.translation.sentences.learning import LEARNING
from opcua_skill.panel.translation.sentences.library import LIBRARY
from opcua_skill.panel.translation.sentences.motion import MOTION
from opcua_skill.panel.translation.sentences.values import VALUES

PATTERNS: dict[str, str] = LEARNING | MOTION | LIBRARY | FILES | VALUES
HOLE = re.compile(r"\{(\w+)\}")
A_NUMBER, A_SENTENCE = re.compile(r"n\d*"), re.compile(r"t\d*")
NUMBER = r"-?(?:\d[\d.]*(?:e[+-]?\d+)?|nan|inf)"
DEEPEST = 12
MOST_WORDS = 4  # of a name, or of a list of names


@dataclass(frozen=True, slots=True)
class Said:
    """A sentence in German, and whether no English is left in it but names."""

    words: str
    whole: bool


@dataclass(frozen=True, slots=True)
class Pattern:
    """One kind of sentence: what recognises it, and what it is in German."""

    english: re.Pattern[str]
    german: str
    fixed: int

    @classmethod
    def of(cls, english: str, german: str) -> "Pattern":
        """Read a pattern with its holes."""
        parts = HOLE.split(english)
        made = [re.escape(part) if k % 2 == 0 else _hole(part) for k, part in enumerate(parts)]
        return cls(re.compile("".join(made), re.DOTALL), german, sum(len(part) for part in parts[::2]))


def _hole(name: str) -> str:
    return f"(?P<{name}>{NUMBER if A_NUMBER.fullmatch(name) else '.+?'})"


class German:
    """Says sentences in German by a table of patterns and one of words."""

    def __init__(self, patterns: Mapping[str, str], words: Mapping[str, str]) -> None:
        self._words = words
        made = [Pattern.of(english, german) for english, german in patterns.items()]
        self._patterns = sorted(made, key=lambda one: -one.fixed)
        self.say = lru_cache(maxsize=4096)(self._say)

    def _say(self, sentence: str, deep: int = 0) -> Said:
        if sentence in self._words:
            return Said(self._words[sentence], True)
        best = Said(sentence, re.fullmatch(NUMBER, sentence) is not None)
        if best.whole:
            return Said(with_comma(sentence), True)
        if deep > DEEPEST:
            return best
        for pattern in self._patterns:
            found = pattern.english.fullmatch(sentence)
            if found is None:
                continue
            parts = {name: self._part(name, text, deep) for name, text in found.groupdict().items()}
            said = pattern.german.format(**{name: part.words for name, part in parts.items()})
            if all(part.whole for part in parts.values()):
                return Said(said, True)
            if best.words == sentence:
                best = Said(said, False)
        return best

    def _part(self, name: str, text: str, deep: int) -> Said:
        if A_NUMBER.fullmatch(name):
            return Said(with_comma(text), True)
        if A_SENTENCE.fullmatch(name):
            return self.say(text, deep + 1)
        return Said(text, len(re.sub(r",\s+", ",", text).split()) <= MOST_WORDS)


def with_comma(text: str) -> str:
    """Return a text with its numbers as German writes them: 6.4 becomes 6,4; dates and versions stay."""
    return re.sub(r"(?<![\w.,])(-?\d+)\.(\d+)(?![\w]*[.\d])", r"\1,\2", text)


SENTENCES = German(PATTERNS, GERMAN)

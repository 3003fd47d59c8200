"""A catalogue: words as they stand, and sentences recognised by how they are made, so that English is the one truth.

A pattern has holes. ``{n}``, ``{n2}`` … are numbers, ``{t}``, ``{t2}`` … sentences or parts of one that are translated
in their turn, any other hole is a name, which stays as it is. Sentences that no pattern knows stay English: better
read than lost.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from babel import UnknownLocaleError
from babel.messages.pofile import read_po
from babel.numbers import get_decimal_symbol

HOLE = re.compile(r"\{(\w+)\}")
A_NUMBER, A_SENTENCE = re.compile(r"n\d*"), re.compile(r"t\d*")
NUMBER = re.compile(r"-?(?:\d[\d.]*(?:e[+-]?\d+)?|nan|inf)")
LONGEST_NUMBER = 30
DEEPEST = 12
MOST_LOOKS = 4_000  # some 10 ms of a processor
MOST_WORDS = 4  # of a name, or of a list of names


@dataclass(frozen=True, slots=True)
class Said:
    """A sentence in a language, and whether no English is left in it but names."""

    words: str
    whole: bool


@dataclass(slots=True)
class Budget:
    """How many looks a sentence may still cost: people's comments are in sentences, and may be made to cost hours."""

    looks: int = MOST_LOOKS
    known: dict[str, "Said"] = field(default_factory=dict)

    def spend(self) -> bool:
        """Take one look; return whether there was one left."""
        self.looks -= 1
        return self.looks >= 0


@dataclass(frozen=True, slots=True)
class Pattern:
    """One kind of sentence: ``fixed`` texts with a hole between each two, and what it is in the language."""

    fixed: tuple[str, ...]
    holes: tuple[str, ...]
    translated: str

    @classmethod
    def of(cls, english: str, translated: str) -> "Pattern":
        """Read a pattern with its holes."""
        parts = HOLE.split(english)
        return cls(tuple(parts[::2]), tuple(parts[1::2]), translated)

    def match(self, sentence: str, budget: Budget) -> dict[str, str] | None:
        """Return what is in the holes, each as short as can be from the left; None where it is another sentence."""
        first, last = self.fixed[0], self.fixed[-1]
        if not sentence.startswith(first) or not sentence.endswith(last):
            return None
        found = self._fill(sentence, 0, len(first), len(sentence) - len(last), budget)
        return None if found is None else dict(zip(self.holes, found, strict=True))

    def _fill(self, sentence: str, hole: int, begin: int, end: int, budget: Budget) -> list[str] | None:
        number = A_NUMBER.fullmatch(self.holes[hole]) is not None
        if hole == len(self.holes) - 1:
            return [sentence[begin:end]] if begin < end and _fits(sentence[begin:end], number) else None
        after, at = self.fixed[hole + 1], begin + 1
        while budget.spend() and (at := sentence.find(after, at, end)) >= 0:
            if _fits(sentence[begin:at], number):
                rest = self._fill(sentence, hole + 1, at + len(after), end, budget)
                if rest is not None:
                    return [sentence[begin:at], *rest]
            elif number and at - begin > LONGEST_NUMBER:
                return None
            at += 1
        return None


def _fits(text: str, number: bool) -> bool:
    return not number or NUMBER.fullmatch(text) is not None


class Catalogue:
    """What there is to say in one language: ``words`` by their English, patterns among them by their holes."""

    def __init__(self, language: str, messages: Mapping[str, str]) -> None:
        self.language = language
        self.words = {english: said for english, said in messages.items() if not HOLE.search(english)}
        self.patterns = {english: said for english, said in messages.items() if HOLE.search(english)}
        made = [Pattern.of(english, said) for english, said in self.patterns.items()]
        self._patterns = sorted(made, key=lambda one: -sum(map(len, one.fixed)))
        self._english = not messages
        self._decimal = decimal_sign(language)
        self.say = lru_cache(maxsize=4096)(self._say)

    @classmethod
    def read(cls, file: Path) -> "Catalogue":
        """Read a gettext catalogue; the file's name is the language. What is not translated yet stays English."""
        with file.open("rb") as stream:
            made = read_po(stream, abort_invalid=True)
        return cls(file.stem, {str(one.id): str(one.string) for one in made if one.id and one.string})

    def word(self, english: str) -> str:
        """Return a word in this language; English stands in for one the catalogue lacks."""
        return self.words.get(english, english)

    def figures(self, text: str) -> str:
        """Return a text with its numbers as the language writes them: 6.4 becomes 6,4; dates and versions stay."""
        if self._decimal == ".":
            return text
        return re.sub(r"(?<![\w.,])(-?\d+)\.(\d+)(?![\w]*[.\d])", rf"\1{self._decimal}\2", text)

    def _say(self, sentence: str) -> Said:
        """Return a sentence in this language."""
        return Said(sentence, True) if self._english else self._part("t", sentence, 0, Budget())

    def _recognised(self, sentence: str, deep: int, budget: Budget) -> Said:
        if sentence not in budget.known:
            budget.known[sentence] = self._looked_for(sentence, deep, budget)
        return budget.known[sentence]

    def _looked_for(self, sentence: str, deep: int, budget: Budget) -> Said:
        if sentence in self.words:
            return Said(self.words[sentence], True)
        if NUMBER.fullmatch(sentence):
            return Said(self.figures(sentence), True)
        best = Said(sentence, False)
        for pattern in self._patterns if deep <= DEEPEST and budget.spend() else ():
            found = pattern.match(sentence, budget)
            if found is None:
                continue
            parts = {name: self._part(name, text, deep + 1, budget) for name, text in found.items()}
            said = pattern.translated.format(**{name: part.words for name, part in parts.items()})
            if all(part.whole for part in parts.values()):
                return Said(said, True)
            if best.words == sentence:
                best = Said(said, False)
        return best

    def _part(self, name: str, text: str, deep: int, budget: Budget) -> Said:
        if A_NUMBER.fullmatch(name):
            return Said(self.figures(text), True)
        if A_SENTENCE.fullmatch(name):
            return self._recognised(text, deep, budget)
        return Said(text, len(re.sub(r",\s+", ",", text).split()) <= MOST_WORDS)


def decimal_sign(language: str) -> str:
    """Return what stands between a number's units and its tenths in a language."""
    try:
        return get_decimal_symbol(language.replace("-", "_"))
    except (UnknownLocaleError, ValueError):
        return "."

"""The panel's words: English as written in the pages, other languages from their catalogues. A test finds every word
that a catalogue lacks.
"""

from opcua_skill.messages import ENGLISH, catalogue_of, languages, negotiated


class Words:
    """Says a word or sentence in one language: ``words("Stop motion")``."""

    def __init__(self, language: str) -> None:
        self.language = language if language in languages() else ENGLISH
        self._catalogue = catalogue_of(self.language)

    def __call__(self, english: str) -> str:
        """Return the word in this language; English stands in for a word the catalogue lacks."""
        return self._catalogue.word(english)

    def count(self, number: int, one: str, many: str) -> str:
        """Return a number with what is counted: ``words.count(n, "demonstration", "demonstrations")``."""
        return f"{number} {self(one if number == 1 else many)}"

    def said(self, sentence: object) -> str:
        """Return a sentence of the server, the readers or the client; English where no pattern knows it."""
        return self._catalogue.say(str(sentence)).words

    def figures(self, text: str) -> str:
        """Return a text with its numbers as this language writes them."""
        return self._catalogue.figures(text)


def language_of(accepted: str) -> str:
    """Return the language a browser asks for first (its Accept-Language header), of those there are."""
    first = accepted.split(",")[0].partition(";")[0]
    return negotiated([first])

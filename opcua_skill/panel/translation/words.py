"""The panel's words: English as written in the pages, German from a table. A test finds every word without German."""

from opcua_skill.panel.translation.german import GERMAN
from opcua_skill.panel.translation.sentences import SENTENCES, with_comma

LANGUAGES = ("en", "de")


class Words:
    """Says a word or sentence in one language: ``words("Stop motion")``."""

    def __init__(self, language: str) -> None:
        self.language = language if language in LANGUAGES else "en"

    def __call__(self, english: str) -> str:
        """Return the word in this language; English stands in for a word the table lacks."""
        return GERMAN.get(english, english) if self.language == "de" else english

    def count(self, number: int, one: str, many: str) -> str:
        """Return a number with what is counted: ``words.count(n, "demonstration", "demonstrations")``."""
        return f"{number} {self(one if number == 1 else many)}"

    def said(self, sentence: object) -> str:
        """Return a sentence of the server, the readers or the client; English where no pattern knows it."""
        return SENTENCES.say(str(sentence)).words if self.language == "de" else str(sentence)

    def figures(self, text: str) -> str:
        """Return a text with its numbers as this language writes them."""
        return with_comma(text) if self.language == "de" else text


def language_of(accepted: str) -> str:
    """Return the language a browser asks for (its Accept-Language header): German if it comes first, else English."""
    return "de" if accepted.strip().lower().startswith("de") else "en"

"""The panel's words: English as written in the pages, German from a table. A test finds every word without German."""

from opcua_skill.panel.german import GERMAN

LANGUAGES = ("en", "de")


class Words:
    """Says a word or sentence in one language: ``words("Stop motion")``."""

    def __init__(self, language: str) -> None:
        self.language = language if language in LANGUAGES else "en"

    def __call__(self, english: str) -> str:
        """Return the word in this language; English stands in for a word the table lacks."""
        return GERMAN.get(english, english) if self.language == "de" else english


def language_of(accepted: str) -> str:
    """Return the language a browser asks for (its Accept-Language header): German if it comes first, else English."""
    return "de" if accepted.strip().lower().startswith("de") else "en"

"""What can be wrong with demonstrations and options, each with what to do about it."""


class SkillError(Exception):
    """A demonstration, an option or a model that cannot be used. The message is one sentence for an operator.

    ``argument`` names what is at fault in the caller's terms: ``demonstrations``, ``options``, ``edits`` or ``model``.
    """

    argument = "demonstrations"


class TooFewDemonstrations(SkillError):
    """Fewer usable demonstrations than a mean needs."""

    def __init__(self, usable: int, needed: int) -> None:
        super().__init__(f"{usable} demonstrations are usable, {needed} are needed: record more, or include some again")

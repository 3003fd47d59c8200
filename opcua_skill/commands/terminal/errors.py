"""What a person did that cannot be done, in one sentence; the command line ends with status 1 and prints it."""

from models.errors import SkillError


class Fault(SkillError):
    """The message is for the person at the keyboard: what is wrong, and what to do."""

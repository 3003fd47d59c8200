"""Every word of the panel has German, and German says nothing that the panel no longer does."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from library.description import Failure
from opcua_skill.commands.terminal.output import counted
from opcua_skill.messages import catalogue_of
from opcua_skill.panel import card, comparing, layout, recipe_fields
from opcua_skill.panel import modes as run_modes
from opcua_skill.panel.formatting import STATE_SIGNS
from opcua_skill.panel.pages import library, recipe_form, teach, upload
from opcua_skill.panel.pages.run import arm, held, jobs, motion, page
from opcua_skill.panel.pages.skill import comparison
from opcua_skill.panel.strokes import NotADemonstration
from opcua_skill.panel.words import Words, language_of
from opcua_skill.security.access import Role
from opcua_skill.wire.values import ENDED

PANEL = Path(layout.__file__).parent


def said(file: Path) -> Iterator[str]:
    """Yield every text that a file passes to ``words(…)`` or ``self.words(…)`` as a literal, or raises for a person."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.For) and getattr(node.target, "id", "") == "head":
            yield from (one.value for one in ast.walk(node.iter) if isinstance(one, ast.Constant))
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in ("legend", "note", "tools"):
            found = [one.value for one in ast.walk(node.value) if isinstance(one, ast.Constant)]
            yield from (text for text in found if text[:1].isupper() or " · " in text)
        if not isinstance(node, ast.Call):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        if name == "count" and isinstance(node.func, ast.Attribute):
            yield from (text for one in node.args[1:] for text in texts(one))
        if node.args and name in ("words", "_part", NotADemonstration.__name__):
            yield from texts(node.args[0])


def texts(said: ast.expr) -> Iterator[str]:
    """Yield a literal, or both arms of a choice between literals."""
    if isinstance(said, ast.IfExp):
        yield from texts(said.body)
        yield from texts(said.orelse)
    elif isinstance(said, ast.Constant) and isinstance(said.value, str):
        yield said.value


def tables() -> Iterator[str]:
    """Yield the texts that the pages keep in tables."""
    yield from (name for name, _ in layout.PAGES)
    yield from layout.MODE_WORDS.values()
    yield layout.LOST
    yield from STATE_SIGNS
    yield from library.STATES
    yield from run_modes.LOOKS
    yield from (text for one in run_modes.LOOKS.values() for text in (one.button, one.name, one.moves))
    yield from (f"needs the role {one.role}" for one in run_modes.LOOKS.values())
    yield from card.SHORT.values()
    yield from held.BECAUSE.values()
    yield from ("arm", "server", held.STEPS)
    yield from motion.STEPS.values()
    yield from jobs.HEADS
    yield from (layout.SILENT, layout.PANEL_SILENT, arm.ACKNOWLEDGE, arm.HOMING)
    yield from ENDED
    yield from page.VIEWS.values()
    yield from recipe_form.TIMINGS
    yield from recipe_form.TIMINGS.values()
    yield from recipe_form.CHOICE_WORDS.values()
    yield from recipe_fields.LABELS.values()
    yield from (figure.label for figure in comparing.FIGURES)
    yield from (label for _, label, _ in comparing.CHANGES)
    yield from comparison.SIGNS
    yield from (arm.OURS, arm.FREE)
    yield from teach.PRESETS
    yield from teach.PRESETS.values()
    yield from upload.ASKED.values()
    yield from (role.value for role in Role)
    yield from (one.value for one in Failure)
    for field in (*recipe_fields.FIELDS, *recipe_fields.PLACE_FIELDS, *recipe_fields.TURN_FIELDS):
        yield field.label
        if field.hint:
            yield field.hint


def test_every_word_has_german() -> None:
    wanted = {text for file in PANEL.rglob("*.py") for text in said(file)} | set(tables())
    missing = sorted(
        text for text in wanted if any(letter.isalpha() for letter in text) and text not in catalogue_of("de").words
    )
    assert not missing, "\n".join(missing)


def test_german_is_asked_for_by_the_browser() -> None:
    assert language_of("de-DE,de;q=0.9,en;q=0.8") == "de"
    assert language_of("en-US,en;q=0.9,de;q=0.1") == "en"
    assert language_of("") == "en"
    assert Words("de")("Run") == "Ausführen"
    assert Words("en")("Run") == "Run"


def test_one_of_a_thing_is_said_in_the_singular() -> None:
    for language, said in (
        ("en", ["0 demonstrations", "1 demonstration", "2 demonstrations"]),
        ("de", ["0 Vorführungen", "1 Vorführung", "2 Vorführungen"]),
    ):
        assert [Words(language).count(number, "demonstration", "demonstrations") for number in range(3)] == said
    assert [counted(number, "press was", "presses were") for number in (1, 2)] == ["1 press was", "2 presses were"]
    assert [counted(number, "file") for number in (0, 1)] == ["0 files", "1 file"]


def test_no_number_stands_before_a_word_that_is_always_in_the_plural() -> None:
    plural = "samples|demonstrations|skills|presses|jobs|users|files|cells|components|versions|recordings"
    wrong = re.compile(r"\{(?!counted|1e3)[^{}]*\} (\{(self\.)?words\('(" + plural + r")\b|(" + plural + r")\b)")
    for folder in (PANEL / "pages", PANEL.parent / "commands"):
        for file in folder.rglob("*.py"):
            found = [line for line in file.read_text(encoding="utf-8").splitlines() if wrong.search(line)]
            assert not found, (file.name, found)

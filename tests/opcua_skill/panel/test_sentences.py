"""Whatever server, learning, arms and readers say to an operator has German: found in the code, not in a list."""

import ast
import itertools
from collections.abc import Iterator
from pathlib import Path

import pytest

from models.errors import TooFewDemonstrations
from opcua_skill.messages import LOCALE, catalogue_of, languages
from opcua_skill.messages.catalogue import DEEPEST, HOLE, Budget, Catalogue
from opcua_skill.security.settings import SecuritySettings

ROOT = Path(__file__).parents[3]
ROOMS = ("models", "library", "sim", "opcua_skill")
# Not seen at the panel: command lines, administration on the data folder, starts, drawings, the rest of OPC UA's stack.
ELSEWHERE = (
    "gateway",
    "programs",
    "description",
    "commands",
    "demo",
    "panel",
    "stack",
    "security",
    "migrations",
)
ALSO_ELSEWHERE = (
    "settings.py", "conformance.py", "figures.py", "cli.py", "picture.py", "worker.py", "disturbances.py",
    "backups.py", "restoring.py", "snapshots.py", "synthetic.py", "lasa.py", "atomic_skills.py", "app.py",
    "world.py", "kinematics.py", "address_space.py", "library_nodes.py", "members.py", "namespaces.py", "nodesets.py",
    "recorder_nodes.py", "skills.py", "types.py", "units.py", "workstation_nodes.py",
    "copying.py", "preparing.py", "roles.py",
)  # fmt: skip
BUILT_IN = (
    "ValueError",
    "RuntimeError",
    "TypeError",
    "KeyError",
    "ConnectionError",
    "FileNotFoundError",
    "LookupError",
)
ENDINGS = (
    "Error", "Refused", "State", "Found", "Value", "Ready", "Executable", "Full", "Use", "Exists", "Unusable", "Fault",
    "Skill", "Another", "Demonstration", "Demonstrations", "Units", "Range", "Components", "Model", "Needed", "Failed",
    "Damaged", "Possible", "Version", "Remark", "Finding", "Exceeded", "Samples", "Died", "Timeout", "End",
)  # fmt: skip
SAYING = ("out_of_range", "invalid", "_left_out", "need", "pause", "abort", "stop", "protective_stop")
KEPT = (
    "text",
    "told",
    "where",
    "needed",
    "reason",
    "words",
    "detail",
    "lost",
    "fault",
    "message",
    "because",
    "comment",
)
COMPOSED = {
    "{} {} usable, {} are needed{}: record more, or include some again": (
        str(TooFewDemonstrations(1, 2)),
        str(TooFewDemonstrations(0, 2, ("person-01: nothing moves further than 1 mm: record it again",))),
    ),
    "{} would be {} {}, {}": (
        "link5 of panda and the part would be 1.2 mm apart at 3.10 s, 41.0 % of the path, 5 mm are needed: move the "
        "part or clear the way",
        "link2 and link7 of panda would be 3.0 mm inside each other on the way to or from the path, 5 mm are needed: "
        "move the part or clear the way",
    ),
    "{} usable demonstrations are needed, {} came{}": (
        "2 usable demonstrations are needed, 1 came",
        "2 usable demonstrations are needed, 1 came; person-02: its DemonstrationId was used before",
    ),
    "{} times need {} values": (),
    "{} of a recording in {} dimensions: {}": ("10 times need 20 values of a recording in 2 dimensions: 19",),
}
"""Sentences put together from parts that are sentences themselves, as they come out."""
SENTENCES = catalogue_of("de")
NAMES = Catalogue("de", SENTENCES.words | SENTENCES.patterns | {"Qx": "Qx"})
Template = list[str | None]
"""A sentence as written: its fixed parts, None where something is put in."""


def files() -> Iterator[Path]:
    for room in ROOMS:
        for file in sorted((ROOT / room).rglob("*.py")):
            if not set(ELSEWHERE) & set(file.relative_to(ROOT).parts) and file.name not in ALSO_ELSEWHERE:
                yield file


def templates(said: ast.expr) -> Iterator[Template]:
    """Yield what an expression can say: literals, f-strings, sums and choices of them."""
    if isinstance(said, ast.Constant) and isinstance(said.value, str):
        yield [said.value]
    elif isinstance(said, ast.JoinedStr):
        yield [str(one.value) if isinstance(one, ast.Constant) else None for one in said.values]
    elif isinstance(said, ast.BinOp) and isinstance(said.op, ast.Add):
        yield from (a + b for a in templates(said.left) for b in templates(said.right))
    elif isinstance(said, ast.BoolOp):
        for one in said.values:
            yield from templates(one)
    elif isinstance(said, ast.IfExp):
        yield from templates(said.body)
        yield from templates(said.orelse)


def sentences(file: Path) -> Iterator[tuple[int, Template]]:
    """Yield every sentence a file gives to a refusal, a finding or a remark, with its line."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        given: list[ast.expr] = []
        if isinstance(node, ast.Call):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            an_error = name[:1].isupper() and name.endswith(ENDINGS) and name not in BUILT_IN
            own = isinstance(node.func, ast.Attribute) and name == "__init__"
            given = [one.value for one in node.keywords if one.arg in KEPT]
            if an_error or own or name in SAYING:
                given = [*node.args, *(one.value for one in node.keywords)]
        elif isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in KEPT:
            given = [node.value]
        for one in given:
            for template in templates(one):
                fixed = "".join(part for part in template if part is not None)
                if " " in fixed.strip():
                    yield node.lineno, template


def filled(template: Template) -> Iterator[str]:
    """Yield a sentence with its holes filled, with numbers and with names in every mixture."""
    holes = sum(part is None for part in template)
    for mixture in itertools.product(("7.25", "Qx"), repeat=holes):
        put = iter(mixture)
        yield "".join(next(put) if part is None else part for part in template)


def has_german(template: Template) -> bool:
    return any(NAMES.say(sentence).whole for sentence in filled(template))


def written(template: Template) -> str:
    return "".join("{}" if part is None else part for part in template)


def test_every_sentence_of_the_server_has_german() -> None:
    found = [(file, line, one) for file in files() for line, one in sentences(file)]
    assert len(found) > 200, "the walk over the code finds too little to be believed"
    assert set(COMPOSED) <= {written(one) for _, _, one in found}, "a sentence is composed that no code says any more"
    missing = [
        f"{file.relative_to(ROOT)}:{line}: {written(one)}"
        for file, line, one in found
        if written(one) not in COMPOSED and not has_german(one)
    ]
    missing += [text for texts in COMPOSED.values() for text in texts if not SENTENCES.say(text).whole]
    assert not missing, f"{len(missing)} sentences without German:\n" + "\n".join(missing)


def test_what_a_configuration_weakens_is_said_in_german() -> None:
    weakened = SecuritySettings(
        Path(), insecure_no_encryption=True, insecure_anonymous=True, insecure_trust_every_client=True
    ).insecure
    assert len(weakened) == 3
    assert all(SENTENCES.say(one).whole for one in weakened)


def test_no_message_stands_twice_and_every_hole_is_filled() -> None:
    for language in languages()[1:]:
        written = (LOCALE / f"{language}.po").read_text(encoding="utf-8").count("\nmsgid ") - 1
        made = catalogue_of(language)
        assert written == len(made.words) + len(made.patterns), language
        for english, said in made.patterns.items():
            assert set(HOLE.findall(said)) <= set(HOLE.findall(english)), english


def test_a_comment_made_to_be_looked_at_for_hours_is_not() -> None:
    looked: list[Budget] = []

    class Watched(Budget):
        def __init__(self) -> None:
            super().__init__()
            looked.append(self)

    for english in SENTENCES.patterns:
        filled = "".join(f"{part or ' '} x " for part in HOLE.split(english)[::2])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("opcua_skill.messages.catalogue.Budget", Watched)
            assert SENTENCES._say((filled * 200)[:2000] + "!").words
    assert len(looked) == len(SENTENCES.patterns)
    recursion = 2 * DEEPEST
    assert min(one.looks for one in looked) > -len(SENTENCES.patterns) * recursion, "work goes on when nothing is left"


@pytest.mark.parametrize(
    ("english", "german"),
    [
        (
            "Approve was refused: engineer taught drawn version 1 and cannot approve it: ask a second engineer "
            "[BadUserAccessDenied]",
            "Approve wurde abgelehnt: engineer hat drawn Version 1 gezeigt und kann sie nicht freigeben: einen zweiten "
            "Ingenieur bitten [BadUserAccessDenied]",
        ),
        (
            "started at 0.02 of the path: used from there; waited for 3.5 s after the last move",
            "begann bei 0,02 der Bahn: ab dort verwendet; wartete 3,5 s nach der letzten Bewegung",
        ),
        ("0.35 of the path: 12 mm to the left of the others", "0,35 der Bahn: 12 mm links von den anderen"),
        (
            "files/wrong.csv, line 3: column 3 holds two, which is not a number; mend the cell or delete the line",
            "files/wrong.csv, Zeile 3: Spalte 3 enthält two, das ist keine Zahl; Zelle berichtigen oder Zeile löschen",
        ),
        (
            "job run-7 of glue is Failed: ProtectiveStop, mes pressed Stop motion at the panel (button)",
            "Auftrag run-7 von glue: Fehlgeschlagen: Schutzhalt, mes hat am Panel „Bewegung stoppen“ gedrückt",
        ),
        ("nobody has written this sentence down", "nobody has written this sentence down"),
    ],
)
def test_sentences_are_said_in_german_with_their_names_and_numbers(english: str, german: str) -> None:
    assert SENTENCES.say(english).words == german


def test_numbers_have_a_comma_and_what_is_no_number_stays() -> None:
    assert SENTENCES.figures("6.4 mm · 75 % · −0.25 · x 1.0") == "6,4 mm · 75 % · −0,25 · x 1,0"
    for same in ("2026-11-28 18:39", "127.0.0.1:4840", "opcua-skill 1.2.3", "run.v1", "plan.csv"):
        assert SENTENCES.figures(same) == same

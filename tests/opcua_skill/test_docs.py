"""Pages keep what they say: links lead somewhere, commands and options exist, code compiles."""

import re
from pathlib import Path

import pytest

from opcua_skill.commands.verbs import VERBS, imported

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md")])
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"```(\w*)\n(.*?)```", re.S)
COMMAND = re.compile(r"(?:^|\s|`)opcua-skill ((?:[a-z]+ ?)+)([^`\n|]*)")


def name(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        if not target.startswith(("http", "#")):
            file = (page.parent / target.partition("#")[0]).resolve()
            assert file.exists(), f"{name(page)}: {target}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_commands_and_their_options_exist(page: Path) -> None:
    for words, rest in COMMAND.findall(page.read_text(encoding="utf-8")):
        verb, *further = words.split()
        assert verb in VERBS, f"{name(page)}: opcua-skill {words}{rest}"
        command = imported(verb, VERBS[verb])
        for word in further:
            below = getattr(command, "commands", None)
            if below is None:
                break
            assert word in below, f"{name(page)}: opcua-skill {words}{rest}"
            command = below[word]
        known = {option for parameter in command.params for option in parameter.opts}
        for option in re.findall(r"(?<![\w-])(--[a-z][a-z-]*)", rest):
            assert option in known | {"--help", "--version"}, f"{name(page)}: opcua-skill {words}{rest}"


@pytest.mark.parametrize("page", PAGES, ids=name)
def test_python_in_pages_compiles(page: Path) -> None:
    for language, code in FENCE.findall(page.read_text(encoding="utf-8")):
        if language == "python" and "…" not in code.replace('"…"', ""):
            compile(code, name(page), "exec", flags=0x2000)  # top-level await

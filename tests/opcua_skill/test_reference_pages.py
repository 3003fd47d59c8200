"""The generated reference pages say what the code says: `python3 dev.py docs` writes them anew."""

import importlib.util
import re
from datetime import datetime
from pathlib import Path
from types import ModuleType
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def build() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_build", ROOT / "docs" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_configuration_page_lists_every_key(build: ModuleType) -> None:
    assert build.CONFIGURATION.read_text(encoding="utf-8") == build.configuration_page()


def test_the_pages_about_events_and_the_command_line_are_what_the_code_says(build: ModuleType) -> None:
    assert build.EVENTS.read_text(encoding="utf-8") == build.events_page()
    assert build.COMMAND_LINE.read_text(encoding="utf-8") == build.command_line_page()


async def test_the_page_about_methods_is_what_a_running_server_has(build: ModuleType) -> None:
    page = build.METHODS.read_text(encoding="utf-8")
    assert page == await build.methods_page()
    for name in (
        "SkillLibrary/LearnFromDemonstration",
        "Machines/<Workstation>/ExecuteSkill",
        "Recorder/AppendSamples",
    ):
        assert f"{name}\n" in page


async def test_the_published_node_set_is_the_one_the_server_has(build: ModuleType) -> None:
    assert _definitions(build.NODE_SET.read_text(encoding="utf-8")) == _definitions(await build.node_set())


def test_the_published_node_set_says_what_it_is_built_from(build: ModuleType) -> None:
    root = ElementTree.parse(build.NODE_SET).getroot()
    space = {"u": "http://opcfoundation.org/UA/2011/03/UANodeSet.xsd"}
    uris = [one.text for one in root.findall("u:NamespaceUris/u:Uri", space)]
    (model,) = root.findall("u:Models/u:Model", space)
    required = model.findall("u:RequiredModel", space)
    assert model.get("ModelUri") == "urn:opcua-skill:types"
    assert sorted([model.get("ModelUri"), *(one.get("ModelUri") for one in required)]) == sorted(
        [build.STANDARD, *uris]
    )
    for one in (model, *required):
        assert one.get("Version")
        assert datetime.fromisoformat(one.get("PublicationDate", "")).year >= 2019


def test_every_file_that_contributors_are_sent_to_is_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = set(re.findall(r"[`(]([\w./-]+\.(?:py|md|toml))[`)]", text))
    assert len(named) > 12
    assert sorted(one for one in named if not (ROOT / one).exists()) == []


def _definitions(text: str) -> str:
    """Return the document without the dates the exporter puts into its head."""
    return re.sub(r'(PublicationDate|LastModified)="[^"]*"', "", text)

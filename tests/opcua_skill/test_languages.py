"""Texts in the language that a client asks for, by a catalogue and nothing else: German, and one made for the test."""

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from small_corner import small_corner

from opcua_skill import messages
from opcua_skill.panel.words import Words, language_of

if TYPE_CHECKING:
    from tests.conftest import Plant

LIMIT = 60.0
ANOTHER = "eo"
A_CATALOGUE = """
msgid ""
msgstr "Content-Type: text/plain; charset=utf-8\\n"

msgid "Run"
msgstr "⟦Run⟧"

msgid "{name} version {n} is {t}, by {user}"
msgstr "⟦{user}: {t} {name} {n}⟧"
"""


@asynccontextmanager
async def signed_in(plant: "Plant", *locales: str) -> AsyncIterator[Client]:
    client = Client(plant.url, timeout=30, watchdog_intervall=15.0)
    client.application_uri = "urn:opcua-skill:client"
    certificate, key = plant.client_folder / "client.der", plant.client_folder / "client.pem"
    mode = ua.MessageSecurityMode.SignAndEncrypt
    await client.set_security(SecurityPolicyBasic256Sha256, str(certificate), str(key), mode=mode)
    client.set_user("mes")
    client.set_password(plant.password)
    client.set_locale(locales)
    async with client:
        yield client


class Heard:
    def __init__(self) -> None:
        self.texts: asyncio.Queue[ua.LocalizedText] = asyncio.Queue()

    def event_notification(self, event: Any) -> None:
        self.texts.put_nowait(event.Message)


@pytest.mark.parametrize(
    ("asked", "locale", "begins"),
    [
        (("de-AT", "en"), "de", "glue-de-AT Version 1: Gelernt, von teacher"),
        (("en", "de"), None, "glue-en version 1 is Learned, by teacher"),
        (("fr",), None, "glue-fr version 1 is Learned, by teacher"),
        ((), None, "glue-none version 1 is Learned, by teacher"),
    ],
)
async def test_an_event_comes_in_the_language_that_was_asked_for(
    plant: "Plant", asked: tuple[str, ...], locale: str | None, begins: str
) -> None:
    name = f"glue-{asked[0] if asked else 'none'}"
    async with signed_in(plant, *asked) as client, plant.sign_in("teacher") as teacher:
        known = await client.get_node(ua.ObjectIds.Server_ServerCapabilities_LocaleIdArray).read_value()
        assert set(known) == set(messages.languages()) and known[0] == "en"
        uri = "urn:opcua-skill:types"
        index = next(i for i, one in enumerate(await client.get_namespace_array()) if one.startswith(uri))
        heard = Heard()
        subscription = await client.create_subscription(50, heard)
        kind = await client.nodes.base_event_type.get_child(f"{index}:SkillVersionStateEventType")
        await subscription.subscribe_events(client.nodes.server, kind)
        await teacher.learn_to_the_end(name, small_corner(4), semantic_type="Gluing")
        text = await asyncio.wait_for(heard.texts.get(), LIMIT)
        await subscription.delete()
    assert text.Text is not None and text.Text.startswith(begins), text
    assert text.Locale == locale


@pytest.fixture
def another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for file in messages.LOCALE.glob("*.po"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / f"{ANOTHER}.po").write_text(A_CATALOGUE, encoding="utf-8")
    monkeypatch.setattr(messages, "LOCALE", tmp_path)
    for kept in (messages.languages, messages.catalogue_of):
        kept.cache_clear()
    yield
    monkeypatch.undo()
    for kept in (messages.languages, messages.catalogue_of):
        kept.cache_clear()


def test_a_third_language_is_a_file_and_nothing_else(another: None) -> None:
    assert messages.languages() == ("en", "de", ANOTHER)
    assert messages.negotiated(["xx", ANOTHER]) == ANOTHER
    words = Words(language_of(f"{ANOTHER},en;q=0.5"))
    assert words("Run") == "⟦Run⟧"
    assert words("Stop motion") == "Stop motion", "what is not translated yet stays English"
    assert words.said("glue version 2 is Approved, by olga") == "⟦olga: Approved glue 2⟧"
    assert words.figures("6.4 mm") == "6,4 mm"
    assert messages.name_of(ANOTHER) == "Esperanto"
    assert Words("de")("Run") == "Ausführen"


@pytest.mark.parametrize("wanted", [[""], ["-"], ["de" * 500], ["\x00"], ["DE"], ["de_DE"], ["d", "e"]])
def test_whatever_is_asked_for_a_language_is_chosen(wanted: list[str]) -> None:
    assert messages.negotiated(wanted) in messages.languages()

"""Whatever is wrong with a skill's file or a recipe is said in German too, pydantic's own words among it."""

import copy
import json
from collections.abc import Iterator
from typing import Any

import pytest

from library.errors import InvalidValue
from library.recipe import Recipe
from library.values import Value
from opcua_skill.messages import catalogue_of
from tests.library.test_description import description

WRONG: list[Any] = [None, "text", "", 5, -1, 2.5, True, [], {}, [1], {"a": 1}, "x" * 5000, -1e30, ["a"], [[1.0]]]
UNREADABLE = ["", "{", "[1,", "nul", '{"a": 1,}', "{'a': 1}", '{"a" 1}', '"\\u12"', "[1 2]", "\x00"]
GERMAN = catalogue_of("de")
VALUES = [description(), Recipe(recipe_id="slow", skill_name="glue")]


def places(node: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """Give the way to everything in a document; of a list to its first two entries."""
    yield path
    inner = node.items() if isinstance(node, dict) else enumerate(node[:2]) if isinstance(node, list) else ()
    for key, value in inner:
        yield from places(value, (*path, key))


def spoilt(document: Any) -> Iterator[Any]:
    """Give the document with each of its parts replaced by each wrong thing, left out, or with one more beside it."""
    for path in places(document):
        for wrong in WRONG:
            whole = copy.deepcopy([document])
            node: Any = whole
            for key in (0, *path)[:-1]:
                node = node[key]
            node[(0, *path)[-1]] = wrong
            yield whole[0]
        if path:
            whole = copy.deepcopy(document)
            node = whole
            for key in path[:-1]:
                node = node[key]
            del node[path[-1]]
            yield whole
    yield {**document, "another": 1}


@pytest.mark.parametrize("value", VALUES, ids=lambda value: type(value).__name__)
def test_what_is_wrong_with_a_field_is_said_in_german(value: Value) -> None:
    kind, left, refused = type(value), set[str](), 0
    texts = [json.dumps(one) for one in spoilt(json.loads(value.to_json()))]
    for text in [*texts, *UNREADABLE]:
        try:
            kind.from_json(text)
        except InvalidValue as refusal:
            refused += 1
            said = GERMAN.say(str(refusal))
            if not said.whole:
                left.add(f"{refusal.allowed} -> {said.words[:100]}")
    assert refused > 200
    assert not left, "\n".join(sorted(left))


@pytest.mark.parametrize(
    ("english", "german"),
    [
        (
            "timing is 'fast': input should be 'demonstrated', 'constant_speed' or 'time_optimal'",
            "Zeitverhalten ist 'fast': erlaubt ist 'demonstrated', 'constant_speed' oder 'time_optimal'",
        ),
        (
            "frame.1 is 'x': input should be a valid number, unable to parse string as a number (and 1 more)",
            "frame.1 ist 'x': es muss eine Zahl sein (und 1 weitere)",
        ),
        (
            "content is 'nul': invalid JSON: EOF while parsing a value at line 1 column 3",
            "content ist 'nul': das ist kein gültiges JSON: es endet zu früh, in Zeile 1, Spalte 3",
        ),
    ],
)
def test_pydantic_s_sentences_are_said_in_german(english: str, german: str) -> None:
    assert GERMAN.say(english).words == german

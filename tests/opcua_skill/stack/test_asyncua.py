"""What our stack puts in place of asyncua's is told here, with what asyncua's was when it was read.

When an upgrade changes one of these, look whether our replacement is still needed, and still fits.
"""

import hashlib
import importlib
import inspect
import json
import subprocess
import sys
from pathlib import Path

import asyncua
import pytest

from opcua_skill.stack.server import ASYNCUA_VERSION
from tests.opcua_skill.stack import (
    test_stock_connections,
    test_stock_decoding,
    test_stock_services,
    test_stock_subscriptions,
)
from tests.opcua_skill.stack.replacements import TESTS, WIRING, exists, overridden

ROOT = Path(__file__).resolve().parents[3]
READ = json.loads((Path(__file__).parent / "asyncua_as_read.json").read_text())


def digest(place: str) -> str:
    """Return the digest of the source of a function or class, named module:qualified.name."""
    module, _, name = place.partition(":")
    found = importlib.import_module(module)
    for part in name.split("."):
        found = inspect.getattr_static(found, part) if inspect.isclass(found) else getattr(found, part)
    found = inspect.unwrap(getattr(found, "__func__", found))
    return hashlib.sha256(inspect.getsource(found).encode()).hexdigest()


def test_the_version_that_was_read_is_the_one_that_runs():
    assert asyncua.__version__ == ASYNCUA_VERSION


@pytest.fixture(scope="module")
def digests() -> dict[str, str]:
    """What asyncua has now, read in a process of its own: in this one a server may have put ours in its place."""
    command = [sys.executable, "-m", "tests.opcua_skill.stack.test_asyncua"]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, timeout=100)
    return json.loads(done.stdout)


@pytest.mark.parametrize("place", READ)
def test_what_is_replaced_is_as_it_was_read(place: str, digests: dict[str, str]):
    told = f"{place} has changed: is our replacement still needed, and does it still fit?"
    assert digests[place] == READ[place], told


def test_each_replacement_has_a_test_of_what_asyncua_does_instead():
    named = TESTS.keys() | WIRING.keys()
    assert not overridden() - named, "say in replacements.py which test of asyncua's own behaviour stands for these"
    assert not [name for name in named if not exists(name)], "replacements.py names what is not there"
    assert not TESTS.keys() & WIRING.keys()


def test_each_test_of_asyncua_s_own_behaviour_stands_for_a_replacement():
    files = (test_stock_connections, test_stock_decoding, test_stock_services, test_stock_subscriptions)
    written = {name for one in files for name in vars(one) if name.startswith("test_")}
    assert written == {name for names in TESTS.values() for name in names}


if __name__ == "__main__":
    print(json.dumps({place: digest(place) for place in READ}))

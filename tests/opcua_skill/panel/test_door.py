"""Where a sign-in may lead, which versions an address may name, and how often a browser may be wrong."""

from urllib.parse import urljoin, urlsplit

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from opcua_skill.panel.door import PAGES, TooManyTries, Tries, version_number, within

BASE = "http://127.0.0.1:8080/sign-in"
AWKWARD = some.text(alphabet="/\\.:@?#%&=\t\n\r\0 aevil5cC2fF\u2028\u3002\uff0f", max_size=24)


def as_a_browser_reads(target: str) -> str:
    """Return the host a browser goes to: it drops tabs and line breaks and reads backslashes as slashes."""
    kept = "".join(sign for sign in target.strip("\0\t\n\r ") if sign not in "\t\n\r").replace("\\", "/")
    return urlsplit(urljoin(BASE, kept)).netloc


@pytest.mark.parametrize(
    "to",
    ["/\\evil.example/", "//evil.example", "/\t/evil.example", "\\\\evil.example", "https://evil.example/", "/%5cevil",
     "javascript:alert(1)", "", "run", "/skill/../..//evil.example", "/skill//evil.example", "/enter?ticket=x",
     "/@evil", "/sign-out", "/\u2028/evil", "/[", "//[", "/skill/" + "x" * 5000],
)  # fmt: skip
def test_a_way_that_leads_elsewhere_leads_to_the_first_page(to: str) -> None:
    assert within(to) == "/"


@pytest.mark.parametrize(
    "to", ["/", "/run?skill=glue&version=3", "/skill/glue", "/skill/J%C3%B6rg%20%26%20co", "/records", "/teach"]
)
def test_a_way_within_is_kept(to: str) -> None:
    assert within(to) == to


@settings(deadline=None, max_examples=500)
@given(
    some.one_of(AWKWARD, AWKWARD.map(lambda rest: "/" + rest), some.text(max_size=30), AWKWARD.map("/skill/".__add__))
)
def test_no_way_leads_out_of_the_panel(to: str) -> None:
    target = within(to)
    assert as_a_browser_reads(target) == urlsplit(BASE).netloc
    assert target.isascii()
    assert target.isprintable()
    assert urlsplit(target).path.split("/")[1] in PAGES
    assert within(target) == target


@settings(deadline=None)
@given(some.one_of(some.text(max_size=30), some.integers().map(str), some.just("9" * 4000), some.just("²")))
def test_a_version_in_an_address_is_one_that_can_be_asked_for(text: str) -> None:
    assert 0 <= int(version_number(text)) < 2**32


def test_a_browser_that_guesses_waits_and_no_other_does() -> None:
    tries = Tries(most=3)
    for _ in range(3):
        tries.check("guesser")
        tries.failed("guesser")
    with pytest.raises(TooManyTries, match=r"try again in \d+ s"):
        tries.check("guesser")
    tries.check("another")
    tries.failed("another")
    tries.good("another")
    tries.check("another")


def test_waiting_ends_by_itself() -> None:
    tries = Tries(most=1, seconds=0.0)
    tries.failed("one")
    tries.check("one")

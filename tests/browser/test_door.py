"""The panel's door, in a browser: who may come in with which cookie, from where, and what no address can do."""

import base64
import json
import os
import re
import socket
import time
from typing import Any
from urllib.parse import quote, urlsplit

import pytest

from tests.browser.conftest import PASSWORD, Screens

pytestmark = pytest.mark.browser


def cookie_of(screen: Any) -> dict[str, Any]:
    [cookie] = [one for one in screen.page.context.cookies() if one["name"] == "session"]
    return cookie


def sign_in(screen: Any, user: str, password: str = PASSWORD) -> None:
    screen.page.locator("input").nth(0).fill(user)
    screen.page.locator("input").nth(1).fill(password)
    screen.page.locator(".sign-in button").click()


def test_signing_in_and_out_gives_a_new_cookie_and_the_old_one_opens_nothing(screens: Screens) -> None:
    screen = screens.blank()
    screen.page.goto(f"{screens.base}/sign-in?to=/run")
    before = cookie_of(screen)
    sign_in(screen, "visitor")
    screen.page.wait_for_selector(".stop-motion")
    assert urlsplit(screen.page.url).path == "/run"
    signed_in = cookie_of(screen)
    assert signed_in["value"] != before["value"]
    assert (signed_in["httpOnly"], signed_in["sameSite"]) == (True, "Strict")
    for other, agent in ((before, None), (signed_in, "another browser")):
        thief = screens.blank(**({"user_agent": agent} if agent else {}))
        thief.page.context.add_cookies([other])
        thief.page.goto(f"{screens.base}/run")
        assert urlsplit(thief.page.url).path == "/sign-in"
    screen.marked("next-person").click()
    screen.page.wait_for_selector(".sign-in")
    left = screens.blank()
    left.page.context.add_cookies([signed_in])
    left.page.goto(f"{screens.base}/records")
    assert urlsplit(left.page.url).path == "/sign-in"


def test_the_next_person_signs_in_with_one_press_and_comes_back_to_the_page(screens: Screens) -> None:
    screen = screens.blank()
    # what a slow machine has for a while: icons are their names, wider than their place, until their font has come
    screen.page.route(re.compile(r"\.woff2"), lambda route: route.abort())
    screen.page.goto(f"{screens.base}/sign-in?to={quote('/records?from=here')}")
    sign_in(screen, "visitor")
    screen.page.wait_for_selector(".stop-motion")
    screen.marked("next-person").click()
    screen.page.wait_for_selector(".sign-in")
    sign_in(screen, "mes")
    screen.marked("person").filter(has_text="mes").wait_for()
    assert screen.page.url == f"{screens.base}/records?from=here"


def test_a_sign_in_leads_only_into_the_panel(screens: Screens) -> None:
    screen = screens.blank()
    screen.page.goto(f"{screens.base}/sign-in?to=/%5Cevil.example/")
    sign_in(screen, "visitor")
    screen.page.wait_for_selector(".stop-motion")
    assert screen.page.url == f"{screens.base}/"
    for way in ("/sign-in?to=//evil.example", "/sign-out?to=/%5Cevil.example", "/enter?ticket=x&to=//evil.example"):
        answer = screen.page.context.request.get(screens.base + way, max_redirects=0)
        assert "evil" not in answer.headers.get("location", "")
    screen.page.wait_for_selector(".sign-in")  # one of them signed out: the open page goes too


def test_wrong_passwords_at_one_browser_lock_nobody_out_at_another(screens: Screens) -> None:
    guesser = screens.blank()
    guesser.page.goto(f"{screens.base}/sign-in")
    wrong = guesser.marked("wrong")
    told = wrong.get_by_text("too many wrong passwords at this browser")
    deadline = time.monotonic() + 60.0
    while not told.is_visible():
        assert time.monotonic() < deadline
        sign_in(guesser, "teacher", "guessed wrong")
        guesser.page.locator(".sign-in button:not([disabled])").wait_for()
    for _ in range(9):
        sign_in(guesser, "teacher", "guessed wrong")
        guesser.page.locator(".sign-in button:not([disabled])").wait_for()
    assert told.is_visible()
    other = screens.blank()
    other.page.goto(f"{screens.base}/sign-in")
    sign_in(other, "teacher")
    other.page.wait_for_selector(".stop-motion")


def upgrade(base: str, origin: str | None) -> str:
    """Ask for the panel's socket as a page of an origin does; return the status line of the answer."""
    host = urlsplit(base).netloc
    lines = [
        "GET /_nicegui_ws/socket.io/?EIO=4&transport=websocket HTTP/1.1",
        f"Host: {host}",
        "Connection: Upgrade",
        "Upgrade: websocket",
        "Sec-WebSocket-Version: 13",
        f"Sec-WebSocket-Key: {base64.b64encode(os.urandom(16)).decode()}",
        *([f"Origin: {origin}"] if origin else []),
    ]
    with socket.create_connection((urlsplit(base).hostname or "", urlsplit(base).port or 0), timeout=20) as asked:
        asked.sendall("\r\n".join([*lines, "", ""]).encode())
        return asked.recv(200).decode("latin-1").split("\r\n")[0]


def test_only_the_panels_own_pages_open_its_socket(panel: str) -> None:
    assert " 101 " in upgrade(panel, panel)
    for origin in ("http://evil.example", "null", f"{panel}.evil.example", "http://127.0.0.1:1", "//[", None):
        assert " 403 " in upgrade(panel, origin)


def test_every_answer_says_what_a_browser_may_do_with_it(screens: Screens) -> None:
    screen = screens.sign_in("visitor")
    for path in ("/", "/sign-in", "/run", "/none", "/panel-static/panel.css", "/healthz"):
        told = screen.page.context.request.get(screens.base + path).headers
        assert "frame-ancestors 'none'" in told["content-security-policy"]
        assert "default-src 'self'" in told["content-security-policy"]
        assert (told["x-content-type-options"], told["x-frame-options"]) == ("nosniff", "DENY")


ODD = ["%00", "%ff%fe", "%ED%A0%80", "%2F", "..%2f..", "9" * 300, "x" * 5000, "%0d%0aSet-Cookie:a=b", "²", "-1", "1e9",
       "{{1}}", "<b>", "%E2%80%AE", "' OR 1=1", "nan", "[]", "\u0663"]  # fmt: skip


def test_no_address_is_an_error_of_the_panel(screens: Screens) -> None:
    screen = screens.sign_in("visitor")
    asked = screen.page.context.request
    wrong: list[str] = []
    for odd in ODD:
        for path in (
            f"/skill/{odd}", f"/skill/x?version={odd}", f"/run?skill={odd}&version={odd}", f"/recipes?skill={odd}",
            f"/{odd}", f"/sign-in?to={odd}", f"/enter?ticket={odd}&to={odd}",
        ):  # fmt: skip
            answer = asked.get(screens.base + path, max_redirects=0)
            if answer.status >= 500:
                wrong.append(f"{answer.status} {path[:60]}")
    assert not wrong, json.dumps(wrong, indent=1)

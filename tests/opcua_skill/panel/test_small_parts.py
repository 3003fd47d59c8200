"""Strokes, uploads, addresses and who is signed in: small rules that keep people and machines safe."""

import ast
import asyncio
from pathlib import Path

import numpy as np
import pytest

from library.errors import ReaderError
from opcua_skill import panel
from opcua_skill.client import JobTrace, Recipe
from opcua_skill.client import Path as LearnedPath
from opcua_skill.panel.app import Address
from opcua_skill.panel.formatting import mm, percent, state_tag
from opcua_skill.panel.layout import may_move, stopped
from opcua_skill.panel.player import in_base, pauses
from opcua_skill.panel.recipe_fields import FIELDS
from opcua_skill.panel.session import PanelSession, Station
from opcua_skill.panel.sessions import Sessions
from opcua_skill.panel.strokes import NotADemonstration, drawn, free_name
from opcua_skill.panel.uploads import uploaded
from opcua_skill.panel.words import Words

FORBIDDEN = ("sim", "opcua_skill.server", "opcua_skill.jobs")
ONLY_READERS = ("library.errors", "library.readers")


def test_the_panel_is_a_client_like_any_other() -> None:
    for file in Path(panel.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                assert not name.startswith((*FORBIDDEN, "opcua_skill.stack", "asyncua", "sqlalchemy")), (file, name)
                assert not name.startswith("library") or name.startswith(ONLY_READERS), (file, name)


def test_no_page_has_a_dialog() -> None:
    for file in Path(panel.__file__).parent.rglob("*.py"):
        source = file.read_text(encoding="utf-8")
        assert "ui.dialog" not in source, file
        assert source.count("ui.select(") == (1 if file.name == "layout.py" else 0), f"{file}: use choose()"


def test_a_replay_knows_where_a_run_stood_still_and_not_where_it_was_slow() -> None:
    times = np.array([0.0, 0.02, 0.04, 5.04, 5.06, 5.30, 5.32, 5.34, 5.36])
    way = np.array([0.0, 1.0, 2.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0])[:, None] * np.array([1e-3, 0.0, 0.0])
    assert pauses(JobTrace(times, way, way)) == [2], "the two rows of the pause; a late row elsewhere moved meanwhile"
    assert pauses(JobTrace(times[:2], way[:2], way[:2])) == []


def test_a_stroke_is_a_demonstration_in_metres_and_seconds() -> None:
    t = np.linspace(3.0, 5.0, 50)
    one = drawn("stroke-01", "tina", t.tolist(), (20 + 10 * t).tolist(), [40.0] * 50)
    assert one.times[0] == 0.0
    assert one.times[-1] == pytest.approx(2.0)
    assert one.points[0] == pytest.approx([0.05, 0.04])
    assert (one.operator, one.dimension) == ("tina", 2)


@pytest.mark.parametrize(
    ("t", "x", "why"),
    [
        ([0.0, 0.1, 0.2], [0.0, 10.0, 20.0], "too few points"),
        (np.linspace(0, 1, 20).tolist(), [5.0] * 20, "shorter than 5 mm"),
        ([0.0] * 20, np.linspace(0, 50, 20).tolist(), "do not rise"),
        (np.linspace(0, 1, 20).tolist(), [float("nan")] * 20, "broken"),
    ],
)
def test_a_stroke_that_is_none_is_refused_with_what_to_do(t: list[float], x: list[float], why: str) -> None:
    with pytest.raises(NotADemonstration, match=why):
        drawn("s", "tina", t, x, [0.0] * len(t))


def test_names_are_free() -> None:
    assert free_name(["stroke-01", "stroke-03"]) == "stroke-02"


@pytest.mark.parametrize("name", ["../../etc/passwd.csv", "..\\..\\boot.csv", "/a/b/c.csv", "", "x" * 5000 + ".csv"])
def test_the_name_of_an_upload_is_never_a_path(name: str) -> None:
    with pytest.raises(ReaderError) as told:
        uploaded(name, b"no table at all")
    assert "etc/" not in str(told.value)


def test_an_uploaded_table_is_read() -> None:
    rows = "\n".join(f"{k / 100},{k},{2 * k}" for k in range(50))
    [one], told = uploaded("by hand.csv", f"t,x_mm,y_mm\n{rows}\n".encode())
    assert one.points[-1] == pytest.approx([0.049, 0.098])
    assert told == []


def test_samples_that_were_not_seen_are_left_out_and_told() -> None:
    rows = "\n".join(f"{k / 100}," + ("," if 20 <= k < 25 else f"{k},{2 * k}") for k in range(50))
    [one], told = uploaded("by hand.csv", f"t,x_mm,y_mm\n{rows}\n".encode())
    assert np.isfinite(one.points).all()
    assert len(one.times) == 45
    assert ["5 of 50 samples were not seen" in line for line in told] == [True]


def test_another_host_needs_tls() -> None:
    assert Address().url == "http://127.0.0.1:8080"
    with pytest.raises(ValueError, match="TLS"):
        Address(host="0.0.0.0")
    assert Address(host="panel.plant", certificate=Path("c"), key=Path("k")).url == "https://panel.plant:8080"
    assert "*" not in Address().names


def test_an_unknown_arm_counts_as_moving() -> None:
    assert may_move(Station("ws1"))
    assert not stopped(Station("ws1"))


def test_a_panel_without_connection_says_that_stop_did_not_reach() -> None:
    session = PanelSession("opc.tcp://127.0.0.1:1", "tina", "secret", why_not="gone")
    outcome = asyncio.run(session.stop_motion("ws1", "test"))
    assert (outcome.taken, outcome.reason) == (False, "gone")
    assert "secret" not in repr(session)


async def test_a_session_ends_some_time_after_its_last_page(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = asyncio.Event()

    async def opened(self: PanelSession) -> None:
        self.on_close(closed.set)

    monkeypatch.setattr(PanelSession, "open", opened)
    sessions = Sessions("opc.tcp://127.0.0.1:1", grace=0.01)
    ticket = await sessions.sign_in("before", "tina", "secret", "en")
    assert sessions.of("before", "mark") is None
    assert await sessions.enter(ticket, "another browser", "mark") is None
    browser = await sessions.enter(ticket, "before", "mark")
    assert browser is not None
    assert await sessions.enter(ticket, "before", "mark") is None
    sessions.page_opened(browser)
    sessions.page_opened(browser)
    sessions.page_closed(browser)
    assert sessions.of(browser, "mark") is not None
    assert sessions.of(browser, "mark of another browser") is None
    assert sessions.of("before", "mark") is None
    sessions.page_closed(browser)
    async with asyncio.timeout(5):
        await closed.wait()
    assert sessions.of(browser, "mark") is None


def test_every_number_of_a_recipe_is_shown_with_unit_and_range() -> None:
    recipe = Recipe("r", "s", time_step=0.008, speed=0.05, dispense_lead=-0.02)
    shown = {field.name: field.shown(getattr(recipe, field.name)) for field in FIELDS}
    assert (shown["time_step"], shown["speed"], shown["dispense_lead"]) == (8.0, 50.0, -20.0)
    step = FIELDS[0]
    assert step.fault(8) == ""
    assert step.fault(None) == step.fault(0.1) == "1 … 20\u00a0ms"


def test_a_part_turned_by_a_quarter_turns_the_path() -> None:
    half = float(np.sqrt(0.5))
    recipe = Recipe("r", "s", frame=(0.4, 0.1, 0.2, 0.0, 0.0, half, half), standoff=0.005)
    path = LearnedPath(np.array([0.0]), np.array([[0.03, 0.01]]), np.zeros((1, 2, 2)), np.ones(1, dtype=bool))
    assert in_base(path, recipe)[0] == pytest.approx([0.39, 0.13, 0.205])


def test_states_are_said_with_a_sign_and_escaped() -> None:
    assert "✓ Freigegeben" in state_tag(Words("de"), "Approved")
    assert "<b>" not in state_tag(Words("en"), "<b>x</b>")
    assert (mm(float("nan")), mm(0.0012), percent(0.5)) == ("–", "1.20\u00a0mm", "50\u00a0%")

"""What every page has: where one is, the arm's state in words, the connection, and Stop motion, always in reach.

No page has a modal dialog, and no list covers the header: a browser test presses Stop motion in every state.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from nicegui import Client, ui
from nicegui.events import Handler, KeyEventArguments, ValueChangeEventArguments

from opcua_skill.client import ClientError
from opcua_skill.messages import languages, name_of
from opcua_skill.panel.session import PanelSession, Station
from opcua_skill.panel.words import Words

LOST = (
    "No connection to the server. What you see here is old, and Stop motion does not reach the arm: "
    "use the emergency stop of the machine."
)
STATIC = Path(__file__).parent / "static"
REFRESH_EVERY = 0.25
BEAT_EVERY = 0.5
HEARTBEAT = """(() => {
  let said = '', at = performance.now();
  setInterval(() => {
    const now = document.querySelector('[data-mark=beat]')?.textContent;
    if (now !== said) { said = now; at = performance.now(); }
    document.body.classList.toggle('panel-is-silent', performance.now() - at > 2500);
  }, 250);
})()"""
PAGES = (("Library", "/"), ("Teach", "/teach"), ("Run", "/run"), ("Records", "/records"))
SILENT = (
    "The server does not answer. What you see here is old. Stop motion is still sent; until it is said to have "
    "arrived, use the emergency stop of the machine."
)
PANEL_SILENT = (
    "This page has lost the panel. What you see is old, and Stop motion does not arrive: use the emergency stop."
)
BACK_SHOWN = 20.0
PRESSED = "(event) => { event.currentTarget.pressed = true; emit(); }"
CLICKED = "(event) => { if (!event.currentTarget.pressed) emit(); event.currentTarget.pressed = false; }"
LEAVE = """() => {
  window.leaving = true;
  location.assign('/sign-out?to=' + encodeURIComponent(location.pathname + location.search));
}"""
REDRAW = "window.leaving || location.reload()"  # a reload would take back the step to another page that was asked for
MODE_WORDS = {
    "closed": "not in contact",
    "idle": "at rest",
    "running": "moving",
    "paused": "paused",
    "stopping": "stopping",
    "protective stop": "protective stop",
    "fault": "fault",
}


@dataclass
class Frame:
    """One page of one browser: its session, its language, and what to do at each refresh."""

    session: PanelSession
    words: Words
    client: Client = field(default_factory=lambda: ui.context.client)
    way: str = ""
    refreshers: list[Callable[[], None]] = field(default_factory=list)
    left: bool = False

    def gate(self, pressed: ui.button, why_not: Callable[[], str]) -> ui.button:
        """Keep a button disabled while ``why_not`` gives a reason, and say it where a mouse or a reader asks."""

        def show() -> None:
            if pressed.is_deleted:
                self.refreshers.remove(show)
                return
            reason = "" if self.session.live else self.words("no connection, or the server does not answer")
            reason = reason or why_not()
            if pressed.enabled != (not reason):
                pressed.set_enabled(not reason)
            if pressed.props.get("title", "") != reason:
                pressed.props["title"] = reason

        self.on_refresh(show)
        return pressed

    def on_refresh(self, do: Callable[[], None]) -> None:
        """Have ``do`` called four times a second; it must only show what the session already knows."""
        self.refreshers.append(do)
        do()

    async def asked(self, doing: str, work: Callable[[], object]) -> bool:
        """Await ``work()``; what the server or the connection says against it is shown. Return whether it was done."""
        try:
            await work()  # type: ignore[misc]
        except ClientError as error:
            self.tell(f"{doing}: {self.words.said(error)}", bad=True)
            return False
        return True

    def tell(self, sentence: str, *, bad: bool = False) -> None:
        """Show a sentence at the bottom of the page for some seconds; what went wrong stays until it is closed."""
        sign = "✕ " if bad else "✓ "
        with self.client:  # whoever asks may have been replaced on the page meanwhile
            ui.notify(
                sign + sentence,
                position="bottom",
                type=None,
                classes="told-bad" if bad else "told-good",
                timeout=0 if bad else 5000,
                close_button=self.words("Close") if bad else False,
                multi_line=True,
            )


def title(text: str, level: int = 2) -> ui.label:
    """Return a heading, for eyes and for screen readers."""
    return ui.label(text).classes("sheet-title").props(f"role=heading aria-level={level}")


def choose(
    options: list[str] | dict[str, str],
    value: str | None,
    on_change: Handler[ValueChangeEventArguments[Any]] | None = None,
    label: str | None = None,
) -> ui.select:
    """Return a drop-down list that never becomes a dialog, not even on a tablet: a dialog would cover Stop motion."""
    made = ui.select(options, value=value, on_change=on_change, label=label)
    return made.props("behavior=menu dense outlined options-dense")


def arm_words(words: Words, station: Station) -> str:
    """Return the state of an arm in words."""
    if station.arm is None:
        return words("state unknown")
    mode = station.arm.mode
    return words(MODE_WORDS[mode]) if mode in MODE_WORDS else mode


def stopped(station: Station) -> bool:
    """Whether the arm waits for a reset."""
    return station.arm is not None and (station.arm.mode == "protective stop" or bool(station.arm.fault))


def may_move(station: Station) -> bool:
    """Whether something moves at a workstation, or could: also when nobody knows."""
    return station.arm is None or not station.arm.at_rest or bool(station.active)


def framed(session: PanelSession, here: str, way: str = "") -> Frame:
    """Build header, banners and keyboard of a page; it goes on below. ``way`` leads to it, quoted."""
    words = Words(session.language)
    frame = Frame(session, words, way=way)
    ui.add_css(STATIC / "panel.css")
    ui.colors(primary="#1f5fa8", secondary="#5b6b7b", accent="#1f5fa8", positive="#2e7d32", negative="#c62828")
    ui.query("html").props(f"lang={session.language}")
    ui.page_title(f"{words(here)} · opcua-skill")
    title(words(here), 1).classes("only-read")
    with ui.header(wrap=False).classes("panel-header"):
        with ui.element("nav").classes("panel-nav").props(f'aria-label="{words("Pages")}"'):
            for name, target in PAGES:
                link = ui.link(words(name), target).classes("panel-link")
                if name == here:
                    link.classes("panel-here").props("aria-current=page")
        ui.space()
        _station_and_connection(frame)
        _person(frame)
        _next_person(frame)
        stop = ui.button().classes("stop-motion").props("unelevated no-caps color=negative icon=front_hand")
        stop.props('data-mark="stop"').bind_text_from(
            session, "station_name", lambda name: f"{words('Stop motion')} {name}"
        )
        # It acts when it is pressed, as a stop does, not when it is let go: a finger that slides off has stopped too.
        stop.on("pointerdown", lambda: _stop(frame, "button"), js_handler=PRESSED)
        stop.on("click", lambda: _stop(frame, "button"), js_handler=CLICKED)
    _banners(frame)
    ui.keyboard(on_key=lambda key: _key(frame, key), ignore=[], repeating=False)
    _heartbeat(frame)
    _redraw_after_a_loss(frame)
    ui.timer(REFRESH_EVERY, lambda: _refresh(frame))
    return frame


def _heartbeat(frame: Frame) -> None:
    """Let the browser see for itself that this process lives: a page that nobody keeps up says so."""
    words = frame.words
    with ui.element("div").classes("banner banner-bad panel-silent").props("role=alert"):
        ui.label(words(PANEL_SILENT)).classes("banner-main")
    beat = ui.label("0").classes("unseen").props('data-mark="beat"')

    def show() -> None:
        beat.text = f"{time.monotonic() // BEAT_EVERY:.0f}"

    frame.on_refresh(show)
    ui.add_body_html(f"<script>{HEARTBEAT}</script>")


def _redraw_after_a_loss(frame: Frame) -> None:
    """Read everything anew once the server is back: only then it may be called true."""
    session, seen = frame.session, frame.session.times_recovered

    def look() -> None:
        nonlocal seen
        if session.times_recovered != seen and session.live:
            seen = session.times_recovered
            with frame.client:
                ui.run_javascript(REDRAW)

    frame.refreshers.append(look)


def _refresh(frame: Frame) -> None:
    if frame.session.ended:
        if not frame.left:
            frame.left = True
            ui.navigate.to(f"/sign-in?to={frame.way}")
        return
    for do in list(frame.refreshers):
        do()


def _station_and_connection(frame: Frame) -> None:
    session, words = frame.session, frame.words

    def moved(event: ValueChangeEventArguments[Any]) -> None:
        session.station_name = event.value

    if len(session.stations) > 1:
        choose(list(session.stations), value=session.station_name, on_change=moved).classes("station-choice").props(
            f'aria-label="{words("Workstation")}" bg-color=white'
        )
    with ui.element("div").classes("panel-state"):
        arm = ui.label().classes("panel-arm").props('data-mark="arm-state" role=status')
        connection = ui.label().classes("panel-connection").props('data-mark="connection" role=status')

    def show() -> None:
        known = session.live and session.station.arm is not None
        arm.text = f"{session.station_name}: {arm_words(words, session.station) if known else words('state unknown')}"
        arm.classes(toggle=None, remove="state-bad state-moving")
        if stopped(session.station) or not known:
            arm.classes("state-bad")
        elif may_move(session.station):
            arm.classes("state-moving")
        if not session.connected:
            connection.text = f"○ {words('NO CONNECTION')}"
        elif session.silent:
            connection.text = f"○ {words('NOT ANSWERING')}"
        else:
            connection.text = f"● {words('connected')}"
        connection.classes(remove="state-bad") if session.live else connection.classes("state-bad")

    frame.on_refresh(show)


def _person(frame: Frame) -> None:
    session, words = frame.session, frame.words

    def speak(language: str) -> None:
        session.language = language
        ui.navigate.reload()

    person = ui.button(session.user).props('flat no-caps icon-right=expand_more data-mark="person"')
    with person.classes("panel-person"), ui.menu().props("auto-close"):
        for language in languages():
            sign = "● " if language == session.language else "○ "
            ui.menu_item(sign + name_of(language), on_click=lambda _, one=language: speak(one))
        ui.menu_item(words("Sign out"), on_click=lambda: ui.navigate.to("/sign-out"))


def _next_person(frame: Frame) -> None:
    """One press, and the next person signs in and comes back to this page: nobody works under a name not theirs."""
    title = frame.words("Next person signs in here")
    ui.button().props(f'flat icon=switch_account data-mark="next-person" aria-label="{title}"').classes(
        "panel-next"
    ).on("click", js_handler=LEAVE).tooltip(title)


def _banners(frame: Frame) -> None:
    session, words = frame.session, frame.words
    with ui.element("div").classes("banner banner-bad").props('data-mark="lost" role=alert') as lost:
        lost_text = ui.label().classes("banner-main")
        why = ui.label().classes("banner-why")
    with ui.element("div").classes("banner banner-bad").props('data-mark="insecure"') as insecure:
        ui.label(words("This server protects less than it should. Whoever runs it has configured that:"))
        weakened = ui.label().classes("banner-main")
    with ui.element("div").classes("banner banner-good").props('data-mark="recovered" role=status') as back:
        back_text = ui.label()
    with ui.element("div").classes("banner banner-bad").props('data-mark="stop-told" role=alert') as told:
        told_text = ui.label()
        ui.button(words("Close"), on_click=lambda: _heard(frame)).props("no-caps flat dense")
    with ui.element("div").classes("banner banner-stop").props('data-mark="protective-stop" role=alert') as stop:
        stop_text = ui.label().classes("banner-main")
        reset = ui.button(words("Reset: the arm may move again"), on_click=lambda: _reset(frame)).props(
            "no-caps outline color=white dense"
        )
    session.kept.setdefault("stop told", "")
    drawn_after = session.times_recovered

    def show() -> None:
        lost.set_visibility(not session.live)
        lost_text.text = words(SILENT if session.silent else LOST)
        weakened.text = "; ".join(words.said(one) for one in session.insecure)
        insecure.set_visibility(bool(session.insecure))
        why.text = words.said(session.why_not)
        since = session.recovered_at
        if since is not None:
            back_text.text = (
                f"✓ {words('The connection is back since')} {since.astimezone():%H:%M:%S}. "
                f"{words('All of this page was read anew: it is true again.')}"
            )
        recent = since is not None and (datetime.now(UTC) - since).total_seconds() < BACK_SHOWN
        back.set_visibility(session.live and recent and drawn_after == session.times_recovered)
        told_text.text = str(session.kept["stop told"])
        told.set_visibility(bool(told_text.text))
        halted = stopped(session.station)
        stop.set_visibility(halted)
        if halted:
            arm = session.station.arm
            assert arm is not None
            stop_text.text = f"■ {session.station_name}: {arm_words(words, session.station)}. {words.said(arm.fault)}"
        reset.set_visibility(session.may("reset"))

    frame.on_refresh(show)


async def _stop(frame: Frame, by: str) -> None:
    session, words = frame.session, frame.words
    station = session.station_name
    if not session.live:
        session.kept["stop told"] = (
            f"… {datetime.now():%H:%M:%S} {words('Stop motion is sent, no answer yet')}: {station}"
        )
        _refresh(frame)
    outcome = await session.stop_motion(station, f"{session.user} pressed Stop motion at the panel ({by})")
    if outcome.taken:
        session.kept["stop told"] = ""
        frame.tell(f"{words('Stop motion taken by')} {station} ({outcome.seconds * 1000:.0f} ms)")
    else:
        told = f"{words('STOP MOTION DID NOT REACH')} {station}! {words('Use the emergency stop.')}"
        session.kept["stop told"] = f"✕ {datetime.now():%H:%M:%S} {told} {words.said(outcome.reason)}"
    _refresh(frame)


def _heard(frame: Frame) -> None:
    """Take away that a stop did not get through: only who has read it may."""
    frame.session.kept["stop told"] = ""
    _refresh(frame)


async def _reset(frame: Frame) -> None:
    session, words = frame.session, frame.words
    if await frame.asked(words("Reset"), lambda: session.client.workstation(session.station_name).reset()):
        session.kept["stop told"] = ""
        session.look_again()


async def _key(frame: Frame, key: KeyEventArguments) -> None:
    """Esc stops whatever moves. When all is known to be at rest it does nothing: closing a list must stop no arm."""
    if key.action.keydown and key.key.escape and may_move(frame.session.station):
        await _stop(frame, "Esc")

"""Signing in: with the user name and password the OPC UA server knows."""

from urllib.parse import quote

from nicegui import ui
from nicegui.events import GenericEventArguments

from opcua_skill.client import ClientError
from opcua_skill.messages import languages
from opcua_skill.panel.door import within
from opcua_skill.panel.layout import STATIC
from opcua_skill.panel.sessions import Sessions
from opcua_skill.panel.words import Words, language_of

# What stands in the fields goes with the press: sent before it, it may arrive after it while a page still connects.
WRITTEN = "() => emit(...[...document.querySelectorAll('.sign-in input')].map((field) => field.value))"
NO_EMERGENCY_STOP = (
    "Stop motion on this panel is a software function. It does not replace the emergency stop of the machine."
)


def sign_in_page(sessions: Sessions, browser: str, to: str, accepted: str) -> None:
    """Ask who is there; go on to ``to``, a path of this panel."""
    target = quote(within(to), safe="")
    ui.add_css(STATIC / "panel.css")
    ui.colors(primary="#1f5fa8", negative="#c62828")

    @ui.refreshable
    def form(language: str) -> None:
        words = Words(language)
        ui.page_title(f"{words('Sign in')} · opcua-skill")
        with ui.element("div").classes("sheet sign-in stack"):
            with ui.element("div").classes("line"):
                ui.label(words("Operator panel")).classes("sheet-title")
                with ui.element("div").classes("at-the-end"):
                    for one in languages():
                        link = ui.link(one.upper(), "#").on("click.prevent", lambda _, it=one: form.refresh(it))
                        link.classes("panel-language" + (" panel-here" if one == language else ""))
            ui.label(sessions.url).classes("soft small")
            user = ui.input(words("User")).props("outlined autofocus autocomplete=username").classes("w-full")
            password = (
                ui.input(words("Password"), password=True)
                .props("outlined autocomplete=current-password")
                .classes("w-full")
            )
            wrong = ui.label().classes("check-bad").props('data-mark="wrong"')
            button = ui.button(words("Sign in")).props("no-caps unelevated").classes("w-full")

            async def enter(event: GenericEventArguments) -> None:
                if not button.enabled:
                    return
                button.disable()
                wrong.text = words("Signing in …")
                name, secret = event.args
                try:
                    ticket = await sessions.sign_in(browser, name, secret, language)
                except ClientError as error:
                    wrong.text = f"✕ {words.said(error)}"
                    button.enable()
                    return
                ui.navigate.to(f"/enter?ticket={ticket}&to={target}")

            button.on("click", enter, js_handler=WRITTEN)
            for field in (user, password):
                field.on("keydown.enter", enter, js_handler=WRITTEN)
            ui.label(words(NO_EMERGENCY_STOP)).classes("soft small")

    form(language_of(accepted))

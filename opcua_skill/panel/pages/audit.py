"""The audit trail: who asked for what on this server, and what came of it; the newest first, nothing can change it."""

import json
import re
from typing import Any

from nicegui import ui

from opcua_skill.client import AuditEntry, ClientError
from opcua_skill.panel.layout import Frame, title

PAGE = 100
LONGEST = 160
DIGEST = re.compile(r"\b([0-9a-f]{12})[0-9a-f]{52}\b")
SIGN_IN = "SignIn"


def in_words(arguments: Any) -> str:
    """Return a call's arguments on one line; long ones are cut."""
    said = " · ".join(
        f"{name}: {value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)}"
        for name, value in dict(arguments).items()
        if value not in ("", [], None)
    )
    said = DIGEST.sub(r"\1…", said)
    return said if len(said) <= LONGEST else f"{said[: LONGEST - 1]}…"


def place_of(target: str) -> str:
    """Return the object a call was made on without its node id's namespace."""
    return target.rpartition("s=")[2] or target


async def audit_page(frame: Frame) -> None:
    """Show the newest entries; older ones page by page."""
    words, session = frame.words, frame.session
    entries: list[AuditEntry] = []
    with ui.element("div").classes("sheet stack"):
        with ui.element("div").classes("line"):
            title(words("Audit trail"))
            only = ui.checkbox(words("only what was refused")).props("dense")
            ins = ui.checkbox(words("sign-ins too")).props("dense")
            who = ui.input(placeholder=words("Who …")).props('dense outlined clearable data-mark="audit-who"')
            what = ui.input(placeholder=words("What …")).props('dense outlined clearable data-mark="audit-what"')
            ui.space()
            ui.button(words("Newest"), icon="refresh", on_click=lambda: newest()).props("no-caps outline")
            ui.button(words("To the records"), on_click=lambda: ui.navigate.to("/records")).props("no-caps flat")
        refused = ui.label().classes("check-bad").props('data-mark="audit-refusal"')
        with (
            ui.element("div").classes("scrolls").props("tabindex=0"),
            ui.element("table").classes("panel-table jobs-table").props('data-mark="audit"') as table,
        ):
            pass
        older = ui.button(words("Older ones"), icon="expand_more", on_click=lambda: more()).props("no-caps outline")
        older.props('data-mark="audit-older"')

    async def ask(before: int) -> list[AuditEntry]:
        try:
            found = await session.client.audit_trail(before=before, limit=PAGE)
        except ClientError as error:
            refused.text = f"✕ {words('The audit trail is for engineers and administrators.')} {words.said(error)}"
            return []
        refused.text = ""
        return found

    async def newest() -> None:
        entries[:] = await ask(0)
        show()

    async def more() -> None:
        if entries:
            entries.extend(await ask(entries[-1].entry_id))
        show()

    def show() -> None:
        older.set_visibility(bool(entries) and entries[-1].entry_id > 1)
        table.clear()
        with table:
            with ui.element("tr"):
                for head in ("Number", "When", "Who", "Role", "What", "Where", "With", "Outcome"):
                    with ui.element("th"):
                        ui.label(words(head))
            for one in entries:
                good = one.status == "Good"
                hidden = (only.value and good) or (good and one.action == SIGN_IN and not ins.value)
                if hidden or not _asked_for(one, who.value or "", what.value or ""):
                    continue
                with ui.element("tr"):
                    when = f"{one.at.astimezone():%Y-%m-%d %H:%M:%S}" if one.at else "–"
                    for cell in (str(one.entry_id), when, one.actor, words(one.role), one.action, place_of(one.target)):
                        with ui.element("td"):
                            ui.label(cell)
                    with ui.element("td").classes("wraps half-wide"):
                        ui.label(in_words(one.arguments)).classes("small soft")
                    with ui.element("td").classes("wraps half-wide"):
                        told = (
                            words("done")
                            if good
                            else f"{one.status}: {words.said(one.reason)}"
                            if one.reason
                            else one.status
                        )
                        ui.label(f"{'✓' if good else '✕'} {told}").classes(
                            f"small {'check-good' if good else 'check-bad'}"
                        )

    for field in (only, ins, who, what):
        field.on_value_change(show)
    await newest()


def _asked_for(one: AuditEntry, who: str, what: str) -> bool:
    said = f"{one.action} {one.target} {in_words(one.arguments)}".lower()
    return who.lower() in one.actor.lower() and what.lower() in said

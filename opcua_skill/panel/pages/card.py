"""The operator card on a page: what is approved, and what is about to run, asked of the server and drawn."""

from nicegui import ui

from opcua_skill.client import ClientError, Path, Recipe, RunCheck
from opcua_skill.panel.card import cannot_run, colours_of, drawn, facts, in_short, slowdowns, speed_steps
from opcua_skill.panel.layout import Frame, title


class CardSheet:
    """The card. ``check`` is what the server said last, None while nothing is known."""

    def __init__(self, frame: Frame, heading: str) -> None:
        self.frame, self.words = frame, frame.words
        self.check: RunCheck | None = None
        self._asked = 0
        title(heading)
        self.place = ui.element("div").classes("stack").props('data-mark="card" aria-live=polite')

    def clear(self, told: str = "") -> None:
        """Show no card, but a sentence, if there is one."""
        self.check = None
        self._asked += 1
        self.place.clear()
        if told:
            with self.place:
                ui.label(told).classes("small soft")

    async def show(self, recipe: Recipe, version: int = 0, before: Path | None = None) -> RunCheck | None:
        """Have a run checked at the workstation that is looked at, and show its card; the newest question wins."""
        words, session = self.words, self.frame.session
        if not session.may("run"):
            self.clear(words("The card of a run needs the role operator."))
            return None
        self.clear(words("The server checks this run …"))
        mine = self._asked
        try:
            check = await session.client.workstation(session.station_name).check(recipe, version)
        except ClientError as error:
            if mine == self._asked:
                self.clear(f"✕ {words.said(error)}")
            return None
        if mine != self._asked:
            return None
        self.check = check
        self.place.clear()
        with self.place:
            self._draw(check, before)
        return check

    def _draw(self, check: RunCheck, before: Path | None) -> None:
        words = self.words
        if refusal := cannot_run(words, check):
            ui.label(f"✕ {refusal}").classes("check-bad").props('data-mark="cannot-run"')
            for one in check.findings:
                ui.label(words.said(one.text)).classes("small")
            return
        ui.html(drawn(words, check, before), sanitize=False).classes("card-views")
        self._legend(check, before)
        with ui.element("div").classes("facts").props('data-mark="card-facts"'):
            for name, value in facts(words, check):
                ui.label(name).classes("soft")
                ui.label(words.figures(value))
        told = slowdowns(check)
        for number, one in enumerate(told, start=1):
            ui.label(f"{number}  {in_short(words, one)} – {words.said(one.text)}").classes("small check-flag").props(
                'data-mark="card-finding"'
            )
        for one in check.findings:
            if one not in told:
                ui.label(f"⚠ {words.said(one.text)}").classes("small check-flag")
        if not told:
            ui.label(words("It slows down nowhere.")).classes("small soft")

    def _legend(self, check: RunCheck, before: Path | None) -> None:
        words = self.words
        bounds, count = speed_steps(check)
        with ui.element("div").classes("line small card-legend"):
            for colour, low, high in zip(colours_of(count), bounds[:-1], bounds[1:], strict=True):
                said = f"{1e3 * low:.0f}–{1e3 * high:.0f}" if count > 1 else f"{1e3 * high:.0f}"
                ui.html(f'<span class="card-key" style="background:{colour}"></span>{said}', sanitize=False)
            ui.label("mm/s")
            ui.html(f'<span class="card-sign card-open">▲</span>{words("valve opens")}', sanitize=False)
            ui.html(f'<span class="card-sign card-close">■</span>{words("valve closes")}', sanitize=False)
            ui.label(f"┈ {words('valve closed')}")
            ui.label(f"▒ {words('Tube ±2σ')}")
            if before is not None:
                ui.label(f"╌ {words('version approved last')}").classes("check-flag")

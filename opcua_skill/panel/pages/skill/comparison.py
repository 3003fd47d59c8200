"""Versions side by side: every figure of their reports, differences marked by sign, word and colour."""

from nicegui import ui

from opcua_skill.client import Path, Skill
from opcua_skill.panel.chart import packed_path
from opcua_skill.panel.comparing import FIGURES, Figure, checks, told_distance
from opcua_skill.panel.formatting import mm, moment_of, percent, state_tag
from opcua_skill.panel.layout import title
from opcua_skill.panel.pages.skill.reviewed import ReviewPage
from opcua_skill.panel.review import largest_change

MOST_BESIDE = 3
SIGNS = {"better": "✓", "worse": "⚠", "differs": "≠"}


class Comparison:
    """The sheet below a skill's page: the version shown first, and up to three others beside it."""

    def __init__(self, page: ReviewPage) -> None:
        self.page, self.words = page, page.words
        self.beside: dict[int, tuple[Skill, Path]] = {}
        self.sheet = ui.element("div").classes("sheet stack").props('data-mark="comparison"')
        self.sheet.set_visibility(False)

    async def add(self, other: Skill) -> None:
        """Put a version beside the one shown, and its path over the chart; the oldest gives way to a fourth one."""
        if other.version not in self.beside:
            await self._read(other)
        self._laid_over(other.version)
        self._show()
        ui.run_javascript(f"getHtmlElement({self.sheet.id}).scrollIntoView({{ behavior: 'smooth' }})")

    async def _read(self, other: Skill) -> None:
        async def read() -> None:
            path = await self.page.session.client.path(other.name, other.version)
            while len(self.beside) >= MOST_BESIDE:
                self.beside.pop(next(iter(self.beside)))
            self.beside[other.version] = (other, path)

        await self.page.frame.asked(self.words("Compare"), read)

    def _laid_over(self, version: int) -> None:
        """Lay another version's path over this one, green and dotted, and say how far apart they are."""
        if version not in self.beside:
            return
        path, words = self.beside[version][1], self.words
        self.page.chart.overlay(other=packed_path(path))
        away, where = self._apart_from(self.beside[version][0], path)
        self.page.say_change(
            f"┄ {words('version')} {version} ({words('green, dotted')}): "
            f"{words('at most')} {words.figures(mm(away))} {words('away')}, "
            f"{words('at')} {percent(where)} {words('of the way')}"
        )

    def _apart_from(self, other: Skill, path: Path) -> tuple[float, float]:
        """Return how far another version's path is away and where: as a report says it, where one does."""
        here = self.page.version
        told = told_distance(here.skill, other) or told_distance(other, here.skill)
        return told or largest_change(path, here.material.path)

    def remove(self, version: int) -> None:
        """Take a version away again, and its path off the chart."""
        self.beside.pop(version, None)
        self.page.chart.overlay(other=None)
        self.page.say_change("")
        self._show()

    def _show(self) -> None:
        words, here = self.words, self.page.version.skill
        self.sheet.clear()
        self.sheet.set_visibility(bool(self.beside))
        others = [one for one, _ in self.beside.values()]
        with self.sheet:
            title(words("Versions side by side"))
            with ui.element("div").classes("scrolls"), ui.element("table").classes("panel-table"):
                self._heads(here, others)
                for figure in FIGURES:
                    if any(figure.read(one) is not None for one in (here, *others)):
                        self._figure(figure, here, others)
                self._apart(others)
                self._notes(here, others)

    def _heads(self, here: Skill, others: list[Skill]) -> None:
        words = self.words
        with ui.element("tr"):
            with ui.element("th"):
                ui.label(words("differences are against the first"))
            for one in (here, *others):
                provenance = one.document.get("provenance") or {}
                with ui.element("th"):
                    with ui.element("div").classes("line"):
                        ui.label(f"{words('version')} {one.version}").classes("sheet-title")
                        ui.html(state_tag(words, one.state), sanitize=False)
                        if one is not here:
                            ui.button(icon="close", on_click=lambda _, number=one.version: self.remove(number)).props(
                                "flat round"
                            ).props["aria-label"] = f"{words('Take away')} {one.version}"
                    told = f"{provenance.get('taughtBy', '')} · {moment_of(provenance.get('taughtAt'))}"
                    ui.label(f"{told} · {words(str(one.report.get('preset', '')))}").classes("small soft")

    def _figure(self, figure: Figure, here: Skill, others: list[Skill]) -> None:
        words = self.words
        with ui.element("tr"):
            with ui.element("td").classes("soft"):
                ui.label(words(figure.label))
            with ui.element("td"):
                ui.label(words.figures(figure.said(figure.read(here)))).classes("mono")
            for one in others:
                mark = figure.mark(here, one)
                with ui.element("td"):
                    ui.label(words.figures(figure.said(figure.read(one)))).classes(
                        "mono" + (" sheet-title" if mark else "")
                    )
                    if mark:
                        ui.label(f"{SIGNS[mark]} {words(mark)}: {words.figures(figure.difference(here, one))}").classes(
                            f"small mark-{mark}"
                        )

    def _apart(self, others: list[Skill]) -> None:
        words = self.words
        with ui.element("tr"):
            with ui.element("td").classes("soft"):
                ui.label(words("path away from the first, largest"))
            with ui.element("td"):
                ui.label("–")
            for one in others:
                away, where = self._apart_from(*self.beside[one.version])
                with ui.element("td"):
                    ui.label(f"{words.figures(mm(away))} {words('at')} {percent(where)}").classes("mono")

    def _notes(self, here: Skill, others: list[Skill]) -> None:
        with ui.element("tr"):
            with ui.element("td").classes("soft"):
                ui.label(self.words("checks"))
            for one in (here, *others):
                with ui.element("td"):
                    for check in checks(self.words, one):
                        look = "check-good" if check.good else "check-bad"
                        ui.label(f"{check.sign} {check.sentence}").classes(f"small {look}")

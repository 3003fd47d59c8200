"""Judging a version: report and checks, approve or reject with a reason, deploy, and the versions side by side."""

import asyncio
import re
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from nicegui import ui

from opcua_skill.client import ClientError, Skill
from opcua_skill.panel.comparing import FIGURES, IN_SHORT, against_paper, checks, since_before, spread
from opcua_skill.panel.formatting import mm, percent, state_tag
from opcua_skill.panel.layout import choose, title
from opcua_skill.panel.pages.skill.approval import RunToApprove
from opcua_skill.panel.pages.skill.reviewed import ReviewPage

OLDEST_SHOWN = 12
RETIRABLE = ("Approved", "Rejected")


class Judging:
    """The right column of a skill's page."""

    def __init__(self, page: ReviewPage) -> None:
        self.page = page
        self.session, self.words = page.session, page.words
        self.skill: Skill = page.version.skill
        self.retiring, self.retire_reason = False, ""
        self.listed: list[tuple[int, str, Mapping[str, Any]]] = []
        with ui.element("div").classes("sheet stack"):
            self._head()
            self.change = ui.label().classes("small").props('data-mark="change"')
            self._report()
        with ui.element("div").classes("sheet stack"):
            self.run_card = RunToApprove(page, self.skill)
        with ui.element("div").classes("sheet stack"):
            title(self.words("Decide"))
            self.decide = ui.element("div").classes("stack")
            self.refresh()
        with ui.element("div").classes("sheet stack"):
            title(self.words("Versions"))
            self.versions = ui.element("div").classes("stack").props('data-mark="versions"')
            ui.timer(0.05, self.read_versions, once=True)

    def _head(self) -> None:
        skill = self.skill
        with ui.element("div").classes("line"):
            title(f"{skill.name} · {self.words('version')} {skill.version}")
        with ui.element("div").classes("line"):
            self.tag = ui.html(state_tag(self.words, skill.state), sanitize=False).props('data-mark="state"')
            ui.label(skill.semantic_type).classes("soft")
        self.newer = ui.element("div").classes("line")

    def _report(self) -> None:
        words, skill = self.words, self.skill
        with ui.element("div").classes("facts"):
            for figure in FIGURES:
                if figure.label not in IN_SHORT:
                    continue
                ui.label(words(figure.label)).classes("soft")
                ui.label(words.figures(figure.said(figure.read(skill))) + self._where(figure.label))
        for check in checks(words, skill):
            ui.label(f"{check.sign} {check.sentence}").classes("small " + ("check-good" if check.good else "check-bad"))
        with ui.element("div").classes("small soft").props('data-mark="compared"'):
            if told := since_before(words, skill):
                ui.label(f"{words('since version')} {skill.report['previous']['version']}: {' · '.join(told)}")
            for sentence in against_paper(words, skill):
                ui.label(sentence)

    def _where(self, label: str) -> str:
        """Return at which share of the path the people were furthest apart."""
        phases, values = (self.skill.report.get("repeatability") or {}).get("phases") or (), spread(self.skill)
        if label != "people's spread, largest" or not values or len(phases) != len(values):
            return ""
        return f" {self.words('at')} {percent(phases[values.index(max(values))])}"

    def refresh(self) -> None:
        """Offer what this person may do with this version in its state; say why something is not offered."""
        words, skill = self.words, self.skill
        self.tag.content = state_tag(words, skill.state)
        self.decide.clear()
        with self.decide:
            for made in skill.document.get("decisions") or ():
                comment = f" – {made['comment']}" if made.get("comment") else ""
                ui.label(f"{words(made['state'])}: {made['actor']}{comment}").classes("small")
            if skill.state == "Learned":
                self._judge()
            elif skill.state == "Approved":
                self._deploy()
            elif skill.state == "Rejected":
                ui.label(words("This version was rejected. Learn again, or choose another version."))
            else:
                ui.label(words("This version is not used any more. Learn again, or choose another version."))
            name = quote(skill.name, safe="")
            target = f"/run?skill={name}&version={skill.version}"
            with ui.element("div").classes("line"):
                ui.button(
                    words("Try it in simulation"),
                    icon="play_arrow",
                    on_click=lambda: ui.navigate.to(target + self.run_card.in_address),
                ).props("no-caps outline dense")
                ui.button(words("Recipes"), on_click=lambda: ui.navigate.to(f"/recipes?skill={name}")).props(
                    "no-caps flat dense"
                )
            self._keep_or_retire()

    @property
    def _own(self) -> bool:
        """Whether this person had a hand in the version or its ancestry, at a server where four eyes are asked for."""
        hands = {one.casefold() for one in self.skill.document.get("contributors") or ()}
        return self.session.four_eyes and self.session.user.casefold() in hands

    def _why_not_judge(self, reason: str) -> str:
        words, session = self.words, self.session
        if not session.live:
            return words("no connection, or the server does not answer")
        if not session.may("approve"):
            return words("Approving needs the role engineer.")
        return "" if reason.strip() else words("Write a reason first: it is kept with the decision.")

    def _judge(self) -> None:
        words = self.words
        comment = (
            ui.input(words("Reason, kept in the records"))
            .props("dense outlined")
            .classes("w-full")
            .props('data-mark="reason"')
        )
        # what is being written stays when the page is drawn anew, also after a lost connection
        comment.bind_value(self.page.version.draft, "reason")
        self.refusal = ui.label().classes("check-bad small").props('data-mark="refusal"')
        unlearned = ui.label(words("Your edits are not part of this version: learn again first."))
        unlearned.classes("small check-bad").props('data-mark="unlearned"')
        unlearned.bind_visibility_from(self.page.version.draft, "changed")
        with ui.element("div").classes("line"):
            yes = ui.button(
                words("Approve"), icon="check", on_click=lambda: self._decided("approve", comment.value or "")
            )
            yes.props("no-caps unelevated dense color=positive").props('data-mark="approve"')
            no = ui.button(words("Reject"), icon="close", on_click=lambda: self._decided("reject", comment.value or ""))
            no.props("no-caps outline dense color=negative").props('data-mark="reject"')
        why = ui.label().classes("small").props('data-mark="why-judge"')

        def offer() -> None:
            reason = self._why_not_judge(comment.value or "")
            why.text = reason
            no.set_enabled(not reason)
            own = words("who taught a version cannot approve it") if not reason and self._own else ""
            yes.set_enabled(not reason and not own)
            if own:
                why.text = f"{words('Approve')}: {own}"

        comment.on_value_change(offer)
        self.offer = offer
        offer()
        ui.label(f"{words('approves model')} {self.skill.model_digest.hex()[:12]}…").classes("small soft mono")

    async def _decided(self, what: str, comment: str) -> None:
        client, skill = self.session.client, self.skill
        ask = client.approve if what == "approve" else client.reject
        try:
            await ask(skill.name, skill.version, skill.model_digest, comment)
        except ClientError as error:
            self.refusal.text = f"✕ {self.words.said(error)}"
            return
        await self.changed_elsewhere()

    def _deploy(self) -> None:
        words, session, skill = self.words, self.session, self.skill
        stations = list(session.stations)
        deployed = list(skill.document.get("workstations") or ())
        told = f"{words('Runs on')}: {', '.join(deployed)}" if deployed else words("Not deployed anywhere yet.")
        ui.label(told).props('data-mark="deployed"')
        if not session.may("deploy"):
            return
        with ui.element("div").classes("line"):
            where = choose(stations, session.station_name).style("width:112px")
            go = ui.button(words("Deploy"), on_click=lambda: self._place(True, where.value)).props('data-mark="deploy"')
            go.props("no-caps unelevated dense")
            back = ui.button(words("Withdraw"), on_click=lambda: self._place(False, where.value)).props(
                'data-mark="withdraw"'
            )
            back.props("no-caps flat dense")
            back.bind_visibility_from(where, "value", lambda name: name in deployed)

    def _keep_or_retire(self) -> None:
        """Offer the version as a file, and to take it out of use for good: with a reason, asked for in place."""
        words, skill = self.words, self.skill
        with ui.element("div").classes("line"):
            ui.button(words("Export as JSON"), icon="download", on_click=self._export).props(
                'no-caps flat dense data-mark="export"'
            )
            ask = ui.button(words("Retire"), icon="archive").props('no-caps flat dense data-mark="retire"')
            ask.set_visibility(skill.state in RETIRABLE and self.session.may("retire"))
        if ask.visible:
            with ui.element("div").classes("stack") as asked:
                reason = ui.input(words("Why it goes out of use")).props("dense outlined").classes("w-full")
                reason.props('data-mark="retire-reason"')
                refused = ui.label().classes("check-bad small").props('data-mark="retire-refusal"')
                ui.button(
                    words("Retire for good"), icon="archive", on_click=lambda: self._retire(reason.value or "", refused)
                ).props('no-caps outline dense color=negative data-mark="retire-now"')
            # What is being written stays when the page is drawn anew because somebody else changed something.
            reason.bind_value(self, "retire_reason")
            asked.bind_visibility_from(self, "retiring")
            ask.on_click(lambda: setattr(self, "retiring", not self.retiring))

    async def _retire(self, reason: str, refused: ui.label) -> None:
        try:
            await self.session.client.retire(self.skill.name, self.skill.version, reason)
        except ClientError as error:
            refused.text = f"✕ {self.words.said(error)}"
            return
        await self.changed_elsewhere()

    async def _export(self) -> None:
        skill, found = self.skill, list[str]()

        async def read() -> None:
            found.append(await self.session.client.export_skill(skill.name, skill.version))

        if await self.page.frame.asked(self.words("Export"), read):
            name = re.sub(r"[^A-Za-z0-9._-]", "_", skill.name).lstrip(".") or "skill"
            with self.page.frame.client:  # the button may have been replaced on the page meanwhile
                ui.download.content(found[0], f"{name}-{skill.version}.json")

    async def _place(self, there: bool, where: str) -> None:
        client, skill = self.session.client, self.skill
        ask = client.deploy if there else client.withdraw
        word = self.words("Deploy") if there else self.words("Withdraw")
        if await self.page.frame.asked(word, lambda: ask(skill.name, skill.version, where)):
            await self.changed_elsewhere()

    async def changed_elsewhere(self) -> None:
        """Read the version's state again, and whether there is a newer version.

        What has not changed is not drawn again: a press on its way to a button that is replaced meanwhile would be
        lost, and so would a reason that is being written.
        """
        before = self.skill

        async def read() -> None:
            self.skill = await self.session.client.skill(before.name, before.version)

        if await self.page.frame.asked(self.words("Read the skill"), read):
            if (self.skill.state, self.skill.document) != (before.state, before.document):
                self.refresh()
            await self.read_versions()

    async def read_versions(self) -> None:
        """List the versions, newest first, each with what tells it from this one."""
        client, name = self.session.client, self.skill.name
        found: list[Skill] = []

        async def read() -> None:
            newest = await client.skill(name)
            found.append(newest)
            oldest = max(newest.version - OLDEST_SHOWN, 0)
            numbers = range(newest.version - 1, oldest, -1)
            found.extend(await asyncio.gather(*(client.skill(name, number) for number in numbers)))

        if not await self.page.frame.asked(self.words("Read the versions"), read):
            return
        await self.run_card.compare(found)
        listed = [(one.version, one.state, one.document) for one in found]
        if listed == self.listed:
            return
        self.listed = listed
        self.versions.clear()
        with self.versions:
            for one in found:
                self._version_line(one)
        self.newer.clear()
        if found[0].version > self.skill.version:
            newest = found[0].version
            taught = (found[0].document.get("provenance") or {}).get("taughtBy", "")
            with self.newer:
                ui.label(f"⚠ {taught}: {self.words('version')} {newest} {self.words('is newer')}").classes(
                    "check-bad small"
                )
                ui.button(self.words("Show it"), on_click=lambda: self._open(newest)).props("no-caps dense flat")

    def _version_line(self, one: Skill) -> None:
        words, here = self.words, one.version == self.skill.version
        error = (one.report.get("path_error") or {}).get("rms")
        taught = (one.document.get("provenance") or {}).get("taughtBy", "")
        with ui.element("div").classes("line").style("gap:4px 8px"):
            ui.label(f"{'▸ ' if here else ''}{one.version}").classes("mono" + (" sheet-title" if here else ""))
            ui.html(state_tag(words, one.state), sanitize=False)
            ui.label(taught).classes("small soft")
            ui.label(words.figures(mm(error))).classes("small mono").tooltip(words("path against mean of people, RMS"))
            if not here:
                with ui.element("div").classes("at-the-end"):
                    ui.button(words("Show"), on_click=lambda: self._open(one.version)).props("no-caps dense flat")
                    ui.button(words("Compare"), on_click=lambda: self.page.compare(one)).props("no-caps dense flat")

    async def _open(self, number: int) -> None:
        self.page.ghost = None
        await self.page.show(number)

    def tell_change(self, before: int, away: float, where: float) -> None:
        """Say what learning again has changed."""
        words = self.words
        self.change.text = (
            f"╌ {words('before')} ({words('version')} {before}, {words('grey dashes')}): "
            f"{words('the path moved by at most')} {words.figures(mm(away))}, "
            f"{words('at')} {percent(where)} {words('of the way')}"
        )

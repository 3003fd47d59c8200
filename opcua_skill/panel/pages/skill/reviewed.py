"""What the sheets of a skill's page share: the version it shows, and what they may ask of the page."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from models.demonstration import Edits
from opcua_skill.client import Path, Skill
from opcua_skill.panel.chart import ReviewChart
from opcua_skill.panel.comparing import wrong
from opcua_skill.panel.layout import Frame
from opcua_skill.panel.review import Draft, Material, edits_of
from opcua_skill.panel.session import PanelSession
from opcua_skill.panel.words import Words


@dataclass
class Version:
    """A version as the page shows it, and the edits under way on it."""

    skill: Skill
    material: Material
    draft: Draft
    flagged: dict[str, str] = field(default_factory=dict)

    @property
    def verdicts(self) -> Mapping[str, Mapping[str, Any]]:
        """What learning said of each recording."""
        return {one["demonstrationId"]: one for one in self.skill.document.get("verdicts") or ()}

    @property
    def flagged_at(self) -> dict[str, float | None]:
        """The recordings that learning found fault with, and where on them."""
        return {name: self.verdicts[name].get("place") for name in self.flagged}


async def read_version(session: PanelSession, name: str, number: int) -> Version:
    """Read a version with everything it is judged by."""
    client = session.client
    skill = await client.skill(name, number)
    recordings = await client.recordings(name, skill.version)
    path = await client.path(name, skill.version)
    material = await asyncio.to_thread(Material.of, recordings.raw, recordings.aligned, path)
    saved = edits_of(skill.document.get("provenance") or {})
    kept = session.kept.setdefault(("draft", name, skill.version), Draft(saved))
    assert isinstance(kept, Draft)
    flagged = {
        one["demonstrationId"]: one.get("reason", "") for one in skill.document.get("verdicts") or () if wrong(one)
    }
    return Version(skill, material, kept, flagged)


class ReviewPage(Protocol):
    """A skill's page as its sheets see it."""

    frame: Frame
    words: Words
    session: PanelSession
    version: Version
    chart: ReviewChart
    ghost: Path | None

    @property
    def edits(self) -> Edits:
        """The edits as they stand."""
        ...

    async def show(self, number: int) -> bool:
        """Read a version and show it in place of what was there."""
        ...

    async def compare(self, other: Skill) -> None:
        """Put another version beside the one shown."""
        ...

    def say_change(self, told: str) -> None:
        """Say, or with nothing unsay, how far another path is from the one shown."""
        ...

    def include(self, name: str, wanted: bool) -> None:
        """Leave a recording out or take it in again."""
        ...

    def refresh(self) -> None:
        """Show the edits as they stand."""
        ...

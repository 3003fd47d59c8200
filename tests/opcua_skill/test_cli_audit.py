"""`audit` shows who did what, newest first, and page by page."""

import asyncio
import json
from pathlib import Path

import pytest

from library.description import AuditEntry
from library.store import SkillLibrary
from opcua_skill.commands.verbs import status_of


async def _filled(folder: Path) -> None:
    async with await SkillLibrary.open(folder / "skills.db") as library:
        for action in ("Approve", "Deploy", "ExecuteSkill"):
            await library.audit(AuditEntry(actor="eve", role="engineer", action=action, status="Good"))


def test_the_trail_is_shown_newest_first_and_by_pages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asyncio.run(_filled(tmp_path))
    assert status_of(["audit", "--data", str(tmp_path), "--limit", "2", "--json"]) == 0
    page = json.loads(capsys.readouterr().out)
    assert [entry["action"] for entry in page] == ["ExecuteSkill", "Deploy"]
    older = ["audit", "--data", str(tmp_path), "--before", str(page[-1]["entry_id"]), "--json"]
    assert status_of(older) == 0
    assert [entry["action"] for entry in json.loads(capsys.readouterr().out)] == ["Approve"]
    assert status_of(["audit", "--data", str(tmp_path)]) == 0
    assert "ExecuteSkill" in capsys.readouterr().out

"""`audit` shows who did what, newest first, and page by page."""

import asyncio
import io
import json
from pathlib import Path

import pytest

from library.description import AuditEntry
from library.store import SkillLibrary
from opcua_skill.client import APPLICATION_URI
from opcua_skill.commands.verbs import status_of
from opcua_skill.security import ensure_client_certificate


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


def test_what_the_command_line_changes_is_in_the_trail(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    data, mine = ["--data", str(tmp_path / "plant")], tmp_path / "client"
    mine.mkdir()
    made = ensure_client_certificate(mine, APPLICATION_URI)
    (tmp_path / "people.csv").write_text("name,role,password\nben,operator,another staple 12\n")
    monkeypatch.setenv("LOGNAME", "root-of-the-plant")

    def run(*words: str, status: int = 0) -> None:
        monkeypatch.setattr("sys.stdin", io.StringIO("correct horse battery\n"))
        assert status_of([*words, *data]) == status, capsys.readouterr().err

    run("users", "add", "eve", "--role", "teacher", "--password-stdin")
    run("users", "import", str(tmp_path / "people.csv"))
    run("users", "role", "eve", "engineer")
    run("users", "password", "eve", "--password-stdin")
    run("users", "remove", "eve")
    run("users", "remove", "eve", status=1)
    run("certificates", "trust", str(made.certificate_file))
    run("certificates", "distrust", made.thumbprint()[:9])
    capsys.readouterr()
    run("audit", "--json")
    found = json.loads(capsys.readouterr().out)
    assert {(entry["actor"], entry["status"]) for entry in found} == {("command line", "Good")}
    assert {entry["arguments"].pop("Login") for entry in found} == {"root-of-the-plant"}
    assert [(entry["action"], entry["target"], entry["arguments"]) for entry in reversed(found)] == [
        ("AddUser", "eve", {"Role": "teacher"}),
        ("AddUser", "ben", {"Role": "operator"}),
        ("SetRole", "eve", {"Role": "engineer"}),
        ("SetPassword", "eve", {}),
        ("RemoveUser", "eve", {}),
        ("TrustCertificate", made.thumbprint(), {"Application": APPLICATION_URI}),
        ("DistrustCertificate", made.thumbprint(), {"Application": APPLICATION_URI}),
    ]


def test_a_certificate_is_trusted_where_there_is_no_library_yet_and_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = ensure_client_certificate(tmp_path, APPLICATION_URI)
    (tmp_path / "plant").mkdir()
    assert status_of(["certificates", "trust", str(made.certificate_file), "--data", str(tmp_path / "plant")]) == 0
    told = capsys.readouterr()
    assert "is trusted" in told.out
    assert "not written into the audit trail" in " ".join(told.err.split())
    assert not (tmp_path / "plant" / "skills.db").exists()

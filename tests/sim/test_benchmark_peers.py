"""A peer that is not there is said to be not there, and no goal is claimed against it."""

import pytest

from benchmarks import execution_peers
from benchmarks.execution import row


def test_a_peer_whose_python_is_missing_is_told_in_words(monkeypatch: pytest.MonkeyPatch, tmp_path) -> None:
    monkeypatch.setenv("OPCUA_SKILL_EXECUTION_PEERS", str(tmp_path / "python"))
    told = execution_peers.answers([])
    assert isinstance(told, str)
    assert "could not be started" in told


def test_a_row_without_a_peer_has_no_ratio() -> None:
    assert (
        row("µs a point", 5.0, "Pinocchio loop: not measured", None, "at least 3 times faster", False)["ratio"] is None
    )

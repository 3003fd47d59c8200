"""`opcua-skill arms`: a stranger's folder is looked at, described and measured before any server knows it."""

import json
from pathlib import Path

import numpy as np
import pytest
from random_orders import ROBOTS
from scipy.spatial.transform import Rotation

from opcua_skill.commands.verbs import status_of
from opcua_skill.configuration.settings import Workstation
from opcua_skill.jobs.station import model_of


def said(capsys: pytest.CaptureFixture[str], *words: object, status: int = 0) -> str:
    capsys.readouterr()
    assert status_of(["arms", *map(str, words)]) == status
    told = capsys.readouterr()
    assert "Traceback" not in told.err
    return told.out if status == 0 or told.out else told.err


def test_a_stranger_gets_from_a_urdf_to_an_arm_that_a_server_takes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (ROBOTS / "gantry.urdf").read_text("utf-8")
    solid = '<link name="z"><collision><geometry><cylinder radius="0.02" length="0.1"/></geometry></collision></link>'
    urdf = tmp_path / "bench.urdf"
    urdf.write_text(text.replace('<link name="z"/>', solid))
    missing = json.loads(said(capsys, "check", tmp_path, "--json", status=1))
    assert (missing["usable"], [one["code"] for one in missing["findings"] if one["weight"] == "error"]) == (
        False,
        ["FilesMissing"],
    )
    told = json.loads(said(capsys, "describe", urdf, "--needle", 0.03, "--json"))
    assert [one["link"] for one in told["hull"]] == ["z"]
    assert 0.0 < told["hull"][0]["sticks_out"] < 0.02
    assert "--again" in said(capsys, "describe", urdf, status=1)
    found = json.loads(said(capsys, "check", tmp_path, "--json", status=1))
    assert [one["code"] for one in found["findings"] if one["weight"] == "error"] == ["Unconfirmed"]
    station = Workstation.model_validate({"name": "bench", "arm": str(tmp_path), "driver": "kinematic"})
    with pytest.raises(ValueError, match="nobody has confirmed home, limits"):
        model_of(station)
    table = tmp_path / "bench.toml"
    table.write_text(table.read_text().replace("to_confirm = [", "to_confirm = []\nwas = ["))
    confirmed = tmp_path / "confirmed"
    confirmed.mkdir()
    for file in (urdf, table):
        file.rename(confirmed / file.name)
    assert "can be used" in said(capsys, "check", confirmed)
    assert model_of(station.model_copy(update={"arm": str(confirmed)})).dof == 3


def test_a_tool_is_measured_from_poses_or_joints_and_one_bad_pose_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    offset = np.array([0.01, 0.0, 0.12])
    turns = Rotation.random(5, rng=4)
    places = np.array([0.4, 0.0, 0.3]) - turns.apply(offset)
    rows = np.hstack([places, turns.as_quat()])
    poses = tmp_path / "poses.csv"
    np.savetxt(poses, rows, delimiter=",", header="x,y,z,qx,qy,qz,qw", comments="")
    told = json.loads(said(capsys, "tool", poses, "--json"))
    assert np.allclose(told["offset"], offset, atol=1e-6)
    assert told["rms"] < 1e-9
    shown = said(capsys, "tool", poses, "--name", "needle 23")
    assert 'name = "needle 23"' in shown
    rows[2, 0] += 0.02
    (tmp_path / "bad.json").write_text(json.dumps(rows.tolist()))
    assert "pose 3 misses" in said(capsys, "tool", tmp_path / "bad.json", status=1)
    assert "joints of gantry" in said(capsys, "tool", poses, "--joints-of", ROBOTS / "gantry", status=1)
    (tmp_path / "words.csv").write_text("a,b\nc,d\n")
    assert "no table of numbers" in said(capsys, "tool", tmp_path / "words.csv", status=1)


def test_a_place_that_is_not_there_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "there is no" in said(capsys, "check", tmp_path / "nowhere", status=1)

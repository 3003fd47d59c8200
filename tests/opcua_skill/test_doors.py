"""An installed distribution brings an arm, a format, a preset and a tracker: no file of ours knows of it."""

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest
from small_corner import small_corner

from opcua_skill.client import LearningOptions, Refused
from tests.conftest import NOT_PASSED_ON, PASSWORD, Plant

ROOT = Path(__file__).resolve().parents[2]
MODULE = '''
import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np

from library.readers.formats import Format
from models.demonstration import Demonstration
from models.presets.paper import fit_as_published
from models.presets import Preset
from opcua_skill.gateway import ReplaySource, SourceFault
from sim.drivers.kinematic.arm import KinematicArm


class Bench(KinematicArm):
    """An arm that says in a file that it was opened."""

    def __init__(self, model, told):
        super().__init__(model, realtime=False)
        self._told = told

    async def open(self):
        await super().open()
        self._told.write_text("open")


def bench(model, settings):
    if "told" not in settings:
        raise ValueError("driver_settings needs told, a file")
    return Bench(model, Path(settings["told"]))


def poses(path, choices):
    rows = np.loadtxt(path)
    return [
        Demonstration(f"{path.stem}-{k}", piece[:, 0], piece[:, 1:], np.ones(len(piece), dtype=bool), "", path.name)
        for k, piece in enumerate(np.split(rows, np.flatnonzero(np.diff(rows[:, 0]) < 0) + 1))
    ]


pose = Format(frozenset({".pose"}), poses)
steady = Preset(fit_as_published, filter_window=0.1, compared=False)


@contextlib.asynccontextmanager
async def played(address):
    if not Path(address).exists():
        raise SourceFault(f"no tracker at {address}")
    yield ReplaySource(poses(Path(address), None), "played", 0.0)
'''
ENTRY_POINTS = """
[opcua_skill.arms]
bench = plantkit:bench
[opcua_skill.readers]
pose = plantkit:pose
[opcua_skill.presets]
steady = plantkit:steady
[opcua_skill.trackers]
played = plantkit:played
"""


class PlantWithKit(Plant):
    """A plant on whose path a distribution lies that is not ours."""

    @property
    def kit(self) -> Path:
        return self.folder / "site"

    @property
    def environment(self) -> dict[str, str]:
        kept = {key: value for key, value in os.environ.items() if not key.startswith(NOT_PASSED_ON)}
        ours = {"OPCUA_SKILL_PASSWORD": PASSWORD, "OPCUA_SKILL_CLIENT_DIR": str(self.client_folder)}
        return {**kept, **ours, "PYTHONPATH": f"{self.kit}{os.pathsep}{ROOT}"}

    def start(self) -> None:
        command = [sys.executable, "-m", "opcua_skill.cli", "serve", "--config", str(self.folder / "plant.toml")]
        command += ["--data", str(self.data), "--endpoint", self.url, "--until-stdin-closes"]
        pipe = subprocess.PIPE
        with (self.folder / "server.log").open("a", encoding="utf-8") as log:
            self.process = subprocess.Popen(  # type: ignore[assignment]
                command, stdin=pipe, stdout=pipe, stderr=log, text=True, env=self.environment, start_new_session=True
            )
        assert self.process.stdout.readline().startswith("listening on "), self.log()

    def said(self, *words: str, status: int = 0) -> str:
        """Return what a command says."""
        command = [sys.executable, "-m", "opcua_skill.cli", *words]
        ended = subprocess.run(command, env=self.environment, capture_output=True, text=True, check=False)
        assert ended.returncode == status, ended.stderr
        return ended.stderr if status else ended.stdout


@pytest.fixture(scope="module")
def kitted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[PlantWithKit]:
    folder = tmp_path_factory.mktemp("kitted")
    plant = PlantWithKit(folder, "")
    plant.settings = textwrap.dedent(f"""
        [[workstations]]
        name = "ws1"
        driver = "bench"
        driver_settings = {{ told = "{folder / "told"}" }}
    """)
    plant.set_up()
    information = plant.kit / "plantkit-1.0.dist-info"
    information.mkdir(parents=True)
    (plant.kit / "plantkit.py").write_text(MODULE, encoding="utf-8")
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: plantkit\nVersion: 1.0\n", encoding="utf-8")
    (information / "entry_points.txt").write_text(ENTRY_POINTS, encoding="utf-8")
    rows = [(time, *point) for one in small_corner() for time, point in zip(one.times, one.points, strict=True)]
    (folder / "people.pose").write_text("\n".join(" ".join(map(str, row)) for row in rows), encoding="utf-8")
    plant.start()
    try:
        yield plant
    finally:
        plant.stop()


async def test_an_arm_a_format_and_a_preset_of_others_run_the_whole_story(kitted: PlantWithKit) -> None:
    at = ("--server", kitted.url, "--user")
    learned = kitted.said(
        "learn", "corner", str(kitted.folder / "people.pose"), "--type", "Gluing", "--option", "preset=steady",
        *at, "teacher", "--json",
    )  # fmt: skip
    told = json.loads(learned)
    assert told["report"]["preset"] == "steady"
    assert len(told["results"]) == 3
    async with kitted.sign_in("engineer") as engineer, kitted.sign_in("mes") as mes:
        assert await engineer.presets() == ("recommended", "free", "paper", "steady")
        skill = await engineer.skill("corner")
        await engineer.approve("corner", skill.version, skill.model_digest)
        await engineer.deploy("corner", skill.version, "ws1")
        job = await mes.workstation("ws1").execute("corner", mode="production")
        report = await mes.follow(job.job_id, on="ws1", limit=60.0)
        assert report.state == "Completed", report
    assert (kitted.folder / "told").read_text(encoding="utf-8") == "open"


def test_a_tracker_of_others_is_recorded_from(kitted: PlantWithKit) -> None:
    at = ("record", "--on", "ws1", "--server", kitted.url, "--user", "teacher", "--json", "--tracker")
    told = kitted.said(*at, f"played:{kitted.folder / 'people.pose'}")
    assert len(json.loads(told)["demonstrations"]) == 3
    assert "no tracker at nowhere" in kitted.said(*at, "played:nowhere", status=1)
    assert "installed are played" in kitted.said(*at, "natnet", status=1)


async def test_what_nobody_brings_is_refused_by_name(kitted: PlantWithKit) -> None:
    async with kitted.sign_in("teacher") as teacher:
        with pytest.raises(Refused, match="'recommended' or 'free' or 'paper' or 'steady'"):
            await teacher.learn(
                "other", small_corner(), semantic_type="Gluing", options=LearningOptions(preset="steddy")
            )
    config = kitted.folder / "other.toml"
    config.write_text('[[workstations]]\nname = "ws1"\ndriver = "bensch"\n', encoding="utf-8")
    serve = ("serve", "--config", str(config), "--data", str(kitted.folder / "other"))
    assert "there are pybullet, kinematic, bench" in kitted.said(*serve, status=1)
    config.write_text('[[workstations]]\nname = "ws1"\ndriver = "bench"\n', encoding="utf-8")
    assert "driver_settings needs told" in kitted.said(*serve, status=1)

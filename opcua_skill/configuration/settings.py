"""Everything that can be configured, in one model: a TOML file, environment variables `OPCUA_SKILL_…`, or neither."""

import os
import tomllib
from pathlib import Path
from typing import Any, Literal
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator
from pydantic_settings import BaseSettings, EnvSettingsSource, SettingsConfigDict

from sim.drivers import SIMULATIONS, driver_names

WORKSTATION_NAME = r"^[A-Za-z][A-Za-z0-9_-]{0,63}$"


def default_data_folder() -> Path:
    """Return where a service of this user keeps its state: `$STATE_DIRECTORY`, `$XDG_DATA_HOME` or `~/.local/share`."""
    if state := os.environ.get("STATE_DIRECTORY"):
        return Path(state.split(":")[0])
    return Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share") / "opcua-skill"


class Section(BaseModel):
    """A part of the configuration; an unknown key is an error, not a surprise."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Equipment(Section):
    """One piece of process equipment and the atomic skills it gives to its workstation."""

    name: str = Field(pattern=WORKSTATION_NAME, description="browse name of the equipment")
    manufacturer: str = Field(default="", description="as on the name plate")
    model: str = Field(default="", description="as on the name plate")
    atomic_skills: tuple[str, ...] = Field(default=(), description="names of atomic skills, e.g. Dispense")


DISPENSER = Equipment(
    name="Dispenser", manufacturer="simulated", model="time-pressure valve", atomic_skills=("Dispense",)
)


class Imperfection(Section):
    """A simulated arm made worse on purpose, to try out the watch over tolerances; its traces are labelled so."""

    lag: float = Field(default=0.0, ge=0.0, le=1.0, description="delay of a simulated arm, s")
    backlash: float = Field(default=0.0, ge=0.0, le=0.1, description="backlash of a simulated arm's joints, rad")
    noise: float = Field(default=0.0, ge=0.0, le=0.1, description="noise of a simulated arm's encoders, rad")

    @property
    def sizes(self) -> tuple[float, float, float]:
        """All numbers; an arm with none above 0 is a good one."""
        return (self.lag, self.backlash, self.noise)


class Fixture(Section):
    """Something that stands in the cell and that the arm has to keep clear of: a box."""

    name: str = Field(description="what it is, for the refusal that names it")
    pose: tuple[float, float, float, float, float, float, float] = Field(
        description="its middle in the arm's base: x y z (m) qx qy qz qw"
    )
    size: tuple[float, float, float] = Field(description="full size along its axes, m")


class ToolTip(Section):
    """Which of the arm's tools it carries, and where the tip is if not where the arm's files have it."""

    name: str = Field(default="", description="one of [[tools]] in the arm's limits file; empty: its first tool")
    offset: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="from that tool's tip, in its frame, m"
    )
    turn: tuple[float, float, float] = Field(default=(0.0, 0.0, 0.0), description="roll, pitch, yaw in that frame, rad")


class Workstation(Section):
    """One workstation: an arm and its process equipment."""

    name: str = Field(default="ws1", pattern=WORKSTATION_NAME, description="browse name under Machines")
    arm: str = Field(
        default="panda",
        description="name of the arm, or the folder with the URDF and the limits file of one's own",
    )
    driver: str = Field(
        default="pybullet", description="what moves: pybullet, kinematic, or an installed driver's name"
    )
    driver_settings: dict[str, Any] = Field(default={}, description="what an installed driver asks for")
    realtime: bool = Field(default=True, description="pace a simulated arm like a real one; false: as fast as possible")
    table_height: float = Field(default=0.0, ge=-2.0, le=2.0, description="the table's plane in the arm's base, m")
    fixtures: tuple[Fixture, ...] = Field(default=(), description="what the arm has to keep clear of")
    workspace_low: tuple[float, float, float] | None = Field(
        default=None,
        description="lower corner of the box in which the nozzle may be, arm's base, m; else the arm's own",
    )
    workspace_high: tuple[float, float, float] | None = Field(
        default=None, description="upper corner of that box, m; else the arm's own"
    )
    home: tuple[float, ...] | None = Field(
        default=None, description="joints at which every run starts and ends, rad or m; else the arm's own"
    )
    tool: ToolTip | None = Field(default=None, description="the tool's tip, where it is not the description's")
    collisions: Literal["checked", "not checked"] = Field(
        default="checked", description="'not checked' lets an arm without a hull run: nothing keeps it from a collision"
    )
    imperfection: Imperfection = Field(default=Imperfection(), description="of a simulated arm")
    equipment: tuple[Equipment, ...] = Field(default=(DISPENSER,), description="process equipment")
    manufacturer: str = Field(default="", description="of the workstation, for its identification")
    model: str = Field(default="", description="of the workstation, for its identification")
    serial_number: str = Field(default="", description="of the workstation, for its identification")


class Limits(Section):
    """What one client may ask for at once; told to clients in SkillLibrary/Limits."""

    max_demonstrations: int = Field(default=200, ge=2, description="demonstrations in one call")
    max_points_per_demonstration: int = Field(default=100_000, ge=2, description="samples of one demonstration")
    max_queued_jobs: int = Field(default=20, ge=1, description="jobs waiting for one arm, and for learning")
    max_job_orders: int = Field(
        default=100,
        ge=1,
        le=1000,
        description="job orders of one workstation that have not ended, and how many are listed",
    )
    max_trajectory_samples: int = Field(default=150_000, ge=2, description="samples in one answer of GetTrajectory")
    max_content: int = Field(default=4_000_000, ge=1, description="characters of a document for ImportSkill")
    max_duration: float = Field(default=36_000.0, gt=0, description="seconds that a path may take")
    max_page: int = Field(default=1000, ge=1, description="rows in one answer of FindSkills, ListRecipes and ListJobs")


class Learning(Section):
    """The learning workers."""

    workers: int = Field(default=1, ge=1, le=64, description="processes that learn")
    timeout: float = Field(default=600.0, gt=0, description="seconds after which a learning job fails")
    answer_within: float = Field(
        default=1.0, gt=0, le=3.0, description="seconds after which the method answers Running"
    )


class Security(Section):
    """Who may connect. The defaults are strict; every weakening has to be said in as many words."""

    allow_anonymous: bool = Field(default=False, description="let clients in without a user name, as observers")
    allow_no_security: bool = Field(default=False, description="offer an endpoint with SecurityPolicy None")
    trust_all_clients: bool = Field(
        default=False, description="accept any client certificate (user sign-in still holds)"
    )


class Settings(BaseSettings):
    """The configuration of one server."""

    model_config = SettingsConfigDict(env_prefix="OPCUA_SKILL_", env_nested_delimiter="__", frozen=True, extra="forbid")

    endpoint: str = Field(default="opc.tcp://127.0.0.1:4840", description="address to listen on")
    data: Path = Field(default_factory=default_data_folder, description="folder of database, certificates and traces")
    database: str = Field(
        default="", description="SQLAlchemy address of the database; empty: skills.db in the data folder"
    )
    host_names: tuple[str, ...] = Field(
        default=(), description="further names or addresses of this server, for its certificate"
    )
    discovery_servers: tuple[str, ...] = Field(
        default=(), description="addresses of discovery servers to register with"
    )
    application_uri: str = Field(
        default="", description="application URI in the server's certificate; empty: made at the first start, then kept"
    )
    four_eyes: bool = Field(default=True, description="who contributed to a version cannot approve it")
    log_level: Literal["debug", "info", "warning", "error"] = Field(default="info", description="how much is logged")
    trace_files: tuple[Literal["csv", "parquet"], ...] = Field(
        default=("csv", "parquet"), description="files written into the data folder's traces/ for every run"
    )
    workstations: tuple[Workstation, ...] = Field(
        default=(Workstation(),), min_length=1, description="the workstations served"
    )
    faces: tuple[Literal["jobs", "machinery"], ...] = Field(
        default=(),
        description="companion specifications shown beside our own nodes: jobs is OPC 40001-3 with 10031-4, machinery "
        "the states of OPC 40001-1",
    )
    limits: Limits = Field(default=Limits(), description="limits of one request")
    learning: Learning = Field(default=Learning(), description="the learning workers")
    security: Security = Field(default=Security(), description="who may connect")

    @field_validator("workstations")
    @classmethod
    def _drivers_are_there(cls, workstations: tuple[Workstation, ...]) -> tuple[Workstation, ...]:
        for station in workstations:
            if station.driver not in driver_names():
                names = ", ".join(driver_names())
                raise ValueError(f"no driver is called {station.driver!r} ({station.name}): there are {names}")
            if station.driver_settings and station.driver in SIMULATIONS:
                raise ValueError(f"{station.name}: a simulation takes no driver_settings")
        return workstations

    @field_validator("endpoint")
    @classmethod
    def _endpoint_is_an_address(cls, endpoint: str) -> str:
        parts = urlsplit(endpoint)
        try:
            good = parts.scheme == "opc.tcp" and bool(parts.hostname) and parts.port is not None
        except ValueError:
            good = False
        if not good:
            raise ValueError(f"{endpoint!r} is no address of a server: write opc.tcp://HOST:PORT")
        return endpoint

    @model_validator(mode="after")
    def _workstation_names_differ(self) -> "Settings":
        names = [station.name for station in self.workstations]
        if len(set(names)) != len(names):
            raise ValueError(f"workstations need names of their own: {', '.join(names)}")
        return self

    @property
    def database_address(self) -> str:
        """The database: as configured, or the file `skills.db` in the data folder."""
        return self.database or str(self.data / "skills.db")

    @classmethod
    def load(cls, config: Path | None = None, **overrides: Any) -> "Settings":
        """Read a TOML file (if any), then the environment, then ``overrides`` that are not None; later ones win.

        Raises pydantic's ValidationError, OSError or tomllib.TOMLDecodeError.
        """
        given = {name: value for name, value in overrides.items() if value is not None}
        from_file = tomllib.loads(config.read_text(encoding="utf-8")) if config else {}
        return cls(**_merged(_merged(from_file, EnvSettingsSource(cls)()), given))


def _merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return ``base`` with ``over`` laid on top, section by section."""
    result = dict(base)
    for name, value in over.items():
        mine = result.get(name)
        result[name] = _merged(mine, value) if isinstance(mine, dict) and isinstance(value, dict) else value
    return result

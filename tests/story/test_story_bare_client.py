"""The main job with a bare OPC UA client and the interface page alone: nothing of the project's own client is used.

People's strokes come from ../shared/data/twenty-people where that folder is there, else from simulated people.
"""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from asyncua import Client, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256

from models.synthetic import simulated_people

if TYPE_CHECKING:
    from tests.conftest import Plant

INSTANCES = "urn:opcua-skill:instances"
REAL = Path(__file__).parents[2].parent / "shared" / "data" / "twenty-people" / "zigzag-w"
LIMIT = 120.0


class Foreign:
    """A bare client and the few lines that any integrator would write around it."""

    def __init__(self, client: Client, instances: int) -> None:
        self.client = client
        self.instances = instances

    def id(self, path: str) -> ua.NodeId:
        return ua.NodeId(path, self.instances)

    async def call(self, place: str, method: str, *arguments: ua.Variant) -> list[Any]:
        """Call a method by the browse path that the interface promises as its NodeId."""
        request = ua.CallMethodRequest(self.id(place), self.id(f"{place}/{method}"), list(arguments))
        [result] = await self.client.uaclient.session.call([request])
        result.StatusCode.check()
        return [variant.Value for variant in result.OutputArguments]

    async def read(self, path: str) -> Any:
        return await self.client.get_node(self.id(path)).read_value()

    async def job_ends(self, place: str, job_id: str) -> Any:
        """Ask until the job has ended."""
        deadline = time.monotonic() + LIMIT
        while True:
            [report] = await self.call(place, "GetJob", text(job_id))
            if report.State in {"Completed", "Failed", "Aborted"}:
                return report
            assert time.monotonic() < deadline, f"job {job_id} is still {report.State}"
            await asyncio.sleep(0.05)


def text(value: str) -> ua.Variant:
    return ua.Variant(value, ua.VariantType.String)


def number(value: int) -> ua.Variant:
    return ua.Variant(value, ua.VariantType.UInt32)


@asynccontextmanager
async def signed_in(plant: "Plant", user: str) -> AsyncIterator[Foreign]:
    """Connect with SignAndEncrypt, a trusted application certificate, a user name and a password."""
    client = Client(plant.url, timeout=30, watchdog_intervall=15.0)
    client.application_uri = "urn:opcua-skill:client"
    client.session_timeout = 60_000
    await client.set_security(
        SecurityPolicyBasic256Sha256,
        str(plant.client_folder / "client.der"),
        str(plant.client_folder / "client.pem"),
        mode=ua.MessageSecurityMode.SignAndEncrypt,
    )
    client.set_user(user)
    client.set_password(plant.password)
    async with client:
        await client.load_data_type_definitions()
        yield Foreign(client, await client.get_namespace_index(INSTANCES))


def strokes() -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Return name, times in s and positions in m of everybody's stroke."""
    if REAL.is_dir():
        found = []
        for file in sorted(REAL.glob("*.csv")):
            rows = np.loadtxt(file, delimiter=",", skiprows=1)
            found.append((file.stem, rows[:, 0] - rows[0, 0], rows[:, 1:3] * 0.001))
        assert len(found) >= 10, f"{REAL} is there but holds too little"
        lowest = np.min([points.min(axis=0) for _, _, points in found], axis=0)
        return [(name, times, points - lowest) for name, times, points in found]
    return [(one.demonstration_id, one.times, one.points) for one in simulated_people(12)[0]]


def demonstrations() -> ua.Variant:
    """Return the strokes as DemonstrationDataType[]."""
    sent = [
        ua.DemonstrationDataType(  # pyright: ignore[reportAttributeAccessIssue]
            DemonstrationId=name,
            Dimension=2,
            Times=times.tolist(),
            Positions=points.ravel().tolist(),
            Operator=name,
            Source="story",
        )
        for name, times, points in strokes()
    ]
    return ua.Variant(sent, ua.VariantType.ExtensionObject)


@pytest.fixture(scope="module")
def plant(make_plant: Callable[..., "Plant"]) -> "Plant":
    return make_plant(driver="pybullet")


async def test_learn_approve_deploy_execute_trace(plant: "Plant") -> None:
    async with signed_in(plant, "teacher") as teacher:
        options = ua.Variant(ua.LearningOptionsDataType(Preset="recommended"))  # pyright: ignore[reportAttributeAccessIssue]
        job_id, state, version, results, report = await teacher.call(
            "SkillLibrary", "LearnFromDemonstration", text("zigzag"), text("Gluing"), demonstrations(), options
        )
        if state != "Completed":
            assert state == "Running"
            job = await teacher.job_ends("SkillLibrary", job_id)
            assert job.State == "Completed", job
            version = job.SkillVersion
        else:
            assert len(results) == len(strokes())
            assert json.loads(report)
        assert version == 1
        [description] = await teacher.call("SkillLibrary", "GetSkill", text("zigzag"), number(0))
        skill = json.loads(description)
        assert (skill["name"], skill["version"], skill["semanticType"], skill["state"]) == (
            "zigzag",
            1,
            "Gluing",
            "Learned",
        )
        digest = ua.Variant(bytes.fromhex(skill["modelDigest"]), ua.VariantType.ByteString)
        with pytest.raises(ua.UaStatusCodeError) as refused:
            await teacher.call("SkillLibrary", "Approve", text("zigzag"), number(1), digest, text("mine"))
        assert refused.value.code == ua.StatusCodes.BadUserAccessDenied

    async with signed_in(plant, "mes") as mes:
        early = (text("zigzag"), text(""), ua.Variant(2, ua.VariantType.Int32))
        with pytest.raises(ua.UaStatusCodeError) as refused:
            await mes.call("Machines/ws1", "ExecuteSkill", *early)
        assert refused.value.code == ua.StatusCodes.BadNotExecutable

    async with signed_in(plant, "engineer") as engineer:
        assert await engineer.call(
            "SkillLibrary", "Approve", text("zigzag"), number(1), digest, text("looks right")
        ) == ["Approved"]
        await engineer.call("SkillLibrary", "Deploy", text("zigzag"), number(1), text("ws1"))
        means = await engineer.read("Machines/ws1/Skills/zigzag/Means")
        covariances = await engineer.read("Machines/ws1/Skills/zigzag/Covariances")
        assert means == np.ravel(skill["means"]).tolist()
        assert covariances == np.ravel(skill["covariances"]).tolist()
        [recipe] = (await engineer.call("SkillLibrary", "ListRecipes", text("zigzag")))[0]
        for name, step in (("slow", 0.02), ("fine", 0.004)):
            recipe.RecipeId, recipe.TimeStep = name, step
            await engineer.call("SkillLibrary", "PutRecipe", ua.Variant(recipe))

    async with signed_in(plant, "mes") as mes:
        samples = []
        for name, step in (("slow", 0.02), ("fine", 0.004)):
            mode = ua.Variant(2, ua.VariantType.Int32)
            job_id, state = await mes.call("Machines/ws1", "ExecuteSkill", text("zigzag"), text(name), mode)
            assert state in {"Queued", "Running"}
            job = await mes.job_ends("Machines/ws1", job_id)
            assert (job.State, int(job.Failure)) == ("Completed", 0), job
            assert job.TrackingError[0] <= 0.0001
            samples.append(job.Samples)
            times, commanded, measured = await mes.call("Machines/ws1", "GetTrace", text(job_id))
            apart = np.reshape(commanded, (len(times), -1)) - np.reshape(measured, (len(times), -1))
            assert np.sqrt(np.mean(np.sum(apart**2, axis=1))) <= 0.0001
            _, path_times, positions, *_ = await mes.call(
                "SkillLibrary", "GetTrajectory", text("zigzag"), number(1), text(name), ua.Variant(0.0)
            )
            assert np.allclose(np.diff(path_times)[:-1], step)
            assert len(positions) == 2 * len(path_times)
        assert samples[0] < samples[1]


async def test_the_path_is_the_same_after_a_restart_bit_for_bit(plant: "Plant") -> None:
    arguments = (text("zigzag"), number(1), text(""), ua.Variant(0.0))
    async with signed_in(plant, "visitor") as visitor:
        before = await visitor.call("SkillLibrary", "GetTrajectory", *arguments)
    await asyncio.to_thread(plant.stop)
    await asyncio.to_thread(plant.start)
    async with signed_in(plant, "visitor") as visitor:
        assert await visitor.call("SkillLibrary", "GetTrajectory", *arguments) == before


async def test_events_reach_a_subscriber_of_the_server_object(plant: "Plant") -> None:
    told: asyncio.Queue[Any] = asyncio.Queue()

    class Listener:
        def event_notification(self, event: Any) -> None:
            told.put_nowait(event)

    async with signed_in(plant, "mes") as mes:
        subscription = await mes.client.create_subscription(50, Listener())
        await subscription.subscribe_events()
        mode = ua.Variant(2, ua.VariantType.Int32)
        job_id, _ = await mes.call("Machines/ws1", "ExecuteSkill", text("zigzag"), text("slow"), mode)
        await mes.job_ends("Machines/ws1", job_id)
        about_the_job = []
        async with asyncio.timeout(LIMIT):
            while not any("ompleted" in message for message in about_the_job):
                event = await told.get()
                assert event.SourceNode is not None
                assert event.Time is not None
                assert event.Severity > 0
                if job_id in str(event.Message.Text):
                    about_the_job.append(event.Message.Text)
        await subscription.delete()

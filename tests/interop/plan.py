"""What a foreign client is told, as JSON and as properties: address, certificate, users, simulated demonstrations."""

import json
from pathlib import Path
from typing import Any

from cryptography.hazmat.primitives import serialization

from models.synthetic import simulated_people
from opcua_skill.client import APPLICATION_URI
from opcua_skill.security import load_certificate


def written(plant: Any, folder: Path, skill: str) -> Path:
    """Write the plan of the story as JSON and return its file."""
    certificate = load_certificate((plant.client_folder / "client.der").read_bytes())
    pem = folder / "client.pem"
    pem.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    people, _ = simulated_people(number=5, seed=3)
    demonstrations = [
        {
            "demonstrationId": one.demonstration_id,
            "dimension": one.points.shape[1],
            "times": (one.times - one.times[0]).tolist(),
            "positions": one.points.ravel().tolist(),
            "triggers": one.triggers.tolist() if one.triggers is not None else [],
            "operator": "foreign",
            "source": "interop",
        }
        for one in people
    ]
    plan = folder / "plan.json"
    content = {
        "url": plant.url,
        "uri": APPLICATION_URI,
        "certificate": str(pem),
        "key": str(plant.client_folder / "client.pem"),
        "folder": str(folder / "pki"),
        "password": plant.password,
        "skill": skill,
        "demonstrations": demonstrations,
    }
    plan.write_text(json.dumps(content))
    files = [_rows(folder, one) for one in demonstrations]
    lines = {**content, "demonstrations": ",".join(map(str, files))}
    (folder / "plan.properties").write_text("".join(f"{key}={value}\n" for key, value in lines.items()))
    return plan


def _rows(folder: Path, one: dict[str, Any]) -> Path:
    """Write a demonstration as rows of time, position and trigger, for clients without a JSON reader."""
    file, dimension = folder / f"{one['demonstrationId']}.csv", one["dimension"]
    places = [one["positions"][at : at + dimension] for at in range(0, len(one["positions"]), dimension)]
    triggers = one["triggers"] or [True] * len(places)
    rows = zip(one["times"], places, triggers, strict=True)
    file.write_text("".join(f"{time},{','.join(map(str, place))},{int(on)}\n" for time, place, on in rows))
    return file


def holds(told: dict[str, Any]) -> None:
    """Check what a foreign client has seen of the main job."""
    assert {"LearnFromDemonstration", "Approve", "Deploy", "FindSkills"} <= set(told["browsed"])
    assert (told["learned"], told["approved"]) == (1, "Approved")
    assert (told["job"], told["refused"]) == ("Completed", "BadUserAccessDenied")
    assert told["samples"] > 100
    assert any("Approve" in message for message in told["events"]), told["events"]

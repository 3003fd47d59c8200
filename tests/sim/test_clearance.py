"""Distances that are never larger than the true ones, and the plans they refuse."""

import math
import struct
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim import robots
from sim.drivers.pybullet.world import mesh_folder
from sim.planning.clearance import Box, _between_segments, _to_box_from_segment, check_clearance
from sim.planning.kinematics import kinematics

Coordinate = st.floats(-1.0, 1.0)
Point = st.tuples(Coordinate, Coordinate, Coordinate)


def vertices(file: Path) -> np.ndarray:
    """Return the vertices (n, 3) of an OBJ or STL file."""
    content = file.read_bytes()
    if file.suffix == ".obj":
        lines = (line.split() for line in content.decode(errors="replace").splitlines() if line.startswith("v "))
        return np.array([[float(value) for value in words[1:4]] for words in lines])
    if content[:5] == b"solid" and b"facet" in content[:300]:
        lines = (line.split() for line in content.decode().splitlines() if "vertex" in line)
        return np.array([[float(value) for value in words[1:]] for words in lines])
    (count,) = struct.unpack_from("<I", content, 80)
    layout = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    return np.frombuffer(content, layout, count, 84)["corners"].reshape(-1, 3).astype(float)


def test_every_vertex_of_every_link_is_inside_its_capsules(model):
    for link in ElementTree.fromstring(model.urdf).findall("link"):
        mesh = link.find("collision/geometry/mesh")
        if mesh is None:
            continue
        points = vertices(mesh_folder() / mesh.get("filename", ""))
        outside = np.full(len(points), math.inf)
        for capsule in model.capsules:
            if capsule.link == link.get("name"):
                start, end = (np.tile(place, (len(points), 1)) for place in (capsule.start, capsule.end))
                outside = np.minimum(outside, _between_segments(points, points, start, end) - capsule.radius)
        assert outside.max() <= 0.0, link.get("name")


def test_the_nozzle_down_to_its_tip_is_covered(model):
    covered = [capsule for capsule in model.capsules if capsule.link == "nozzle"]
    tip = max(capsule.end[2] + capsule.radius for capsule in covered)
    assert tip == pytest.approx(model.tool.length, abs=1e-3)


@settings(deadline=None, max_examples=60)
@given(Point, Point, Point, Point)
def test_segments_are_as_far_apart_as_their_nearest_points(p1, q1, p2, q2):
    ends = [np.array([point]) for point in (p1, q1, p2, q2)]
    part = np.linspace(0.0, 1.0, 201)[:, None]
    first, second = ends[0] + part * (ends[1] - ends[0]), ends[2] + part * (ends[3] - ends[2])
    sampled = np.sqrt(((first[:, None] - second[None]) ** 2).sum(axis=2)).min()
    exact = float(_between_segments(*ends)[0])
    assert exact <= sampled + 1e-9
    assert sampled - exact < 0.02


@settings(deadline=None, max_examples=60)
@given(Point, Point)
def test_a_segment_is_as_far_from_a_box_as_its_nearest_point(p, q):
    box = Box("b", (0.1, 0.2, 0.0, 0.0, 0.0, math.sin(0.3), math.cos(0.3)), (0.4, 0.2, 0.6))
    start, end = np.array([p]), np.array([q])
    points = start + np.linspace(0.0, 1.0, 401)[:, None] * (end - start)
    sampled = _to_box_from_segment(points, points, box).min()
    exact = float(_to_box_from_segment(start, end, box)[0])
    assert exact <= sampled + 1e-9
    assert sampled - exact < 0.01


def test_an_arm_folded_into_itself_is_found(panda):
    folded = np.array([[0.0, 1.5, 0.0, -3.0, 0.0, 1.0, 0.0]])
    found, nearest = check_clearance(panda, folded, np.zeros(1), np.array([0.5]), ())
    assert [finding.code for finding in found] == ["Collision"]
    assert nearest < 0.0
    assert "of panda" in found[0].text


def test_the_arm_at_home_is_clear_of_itself_and_of_the_table(model):
    table = Box("table", (0.0, 0.0, -0.5, 0.0, 0.0, 0.0, 1.0), (4.0, 4.0, 1.0))
    found, nearest = check_clearance(model, np.array([model.home]), np.zeros(1), np.zeros(1), (table,))
    assert not found
    assert nearest > 0.005


def test_an_elbow_through_the_table_is_found(panda):
    low = np.array([[0.0, 1.7, 0.0, -0.3, 0.0, 2.0, 0.0]])
    table = Box("table", (0.0, 0.0, -0.5, 0.0, 0.0, 0.0, 1.0), (4.0, 4.0, 1.0))
    found, _ = check_clearance(panda, low, np.zeros(1), np.array([math.nan]), (table,))
    assert any("table" in finding.text for finding in found)
    assert "on the way to or from the path" in found[0].text


def test_only_the_needle_may_come_near_the_part(panda):
    position = kinematics(panda).seed_position
    part = Box("part", (*(position[:2]), position[2] - 0.05, 0.0, 0.0, 0.0, 1.0), (0.1, 0.1, 0.1))
    home = np.array([panda.home])
    assert not check_clearance(panda, home, np.zeros(1), np.zeros(1), (part,))[0]
    clamp = replace(part, name="clamp")
    assert check_clearance(panda, home, np.zeros(1), np.zeros(1), (clamp,))[0]


def test_every_arm_watches_its_nozzle_against_its_base():
    for name in robots.names():
        assert any({"link0", "nozzle"} == set(pair) for pair in robots.load(name).apart)

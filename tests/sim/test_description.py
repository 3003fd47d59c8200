"""Arms as strangers bring them: everything odd is told with its way out, and a first limits file is proposed."""

import math
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_orders import ROBOTS, own_arm
from scipy.spatial.transform import Rotation

from sim import robots
from sim.description import meshes, urdf
from sim.description.capsules import beyond, fit
from sim.description.checking import check_arm, check_place
from sim.description.proposal import NotDescribable, propose, written
from sim.description.tool_point import PosesRefused, tool_point
from sim.drivers.pybullet.arm import PyBulletArm
from sim.planning.planner import plan_home
from sim.testing.conformance import line_plan

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def folder(tmp_path: Path, name: str = "gantry", **changes: tuple[str, str]) -> Path:
    """Return the path without ending of an arm's files, with words of theirs exchanged."""
    for kind in ("urdf", "toml"):
        text = (ROBOTS / f"{name}.{kind}").read_text("utf-8")
        before, after = changes.get(kind, ("", ""))
        assert before in text
        (tmp_path / f"{name}.{kind}").write_text(text.replace(before, after, 1) if before else text, "utf-8")
    return tmp_path / name


def codes(stem: Path, weight: str = "error") -> set[str]:
    return {one.code for one in check_arm(stem) if one.weight == weight}


JX = '<joint name="jx" type="prismatic">'
ODD = [
    ("urdf", 'type="prismatic"', 'type="planar"', "JointType"),
    ("urdf", 'type="prismatic"', 'type="floating"', "JointType"),
    ("urdf", JX, JX + '<mimic joint="jy"/>', "Mimic"),
    ("urdf", '<axis xyz="1 0 0"/>', '<axis xyz="0 0 0"/>', "NoAxis"),
    ("urdf", '<axis xyz="1 0 0"/>', '<axis xyz="1 0"/>', "NoAxis"),
    ("urdf", 'xyz="0 0 0.5"', 'xyz="0 0 500"', "InMillimetres"),
    ("urdf", 'xyz="0 0 0.5"', 'xyz="0 nan 0.5"', "NumberUnreadable"),
    ("urdf", 'rpy="3.141592653589793 0 0"', 'rpy="180 0 0"', "InDegrees"),
    ("urdf", 'lower="0" upper="0.8"', 'lower="0" upper="800"', "InMillimetres"),
    ("urdf", 'lower="0" upper="0.8"', 'lower="0.8" upper="0"', "LimitsSwapped"),
    ("urdf", 'lower="0" upper="0.8"', 'lower="0" upper="0"', "ZeroLimits"),
    ("urdf", '<link name="x"/>', '<link name="x"/><link name="x"/>', "DuplicateName"),
    ("urdf", 'name="jy"', 'name="jx"', "DuplicateName"),
    ("urdf", '<link name="y"/>', "", "UnknownLink"),
    ("urdf", '<link name="x"/>', '<link name="x"/><link name="lonely"/>', "SeveralRoots"),
    ("urdf", '<parent link="base"/>', '<parent link="z"/>', "Loop"),
    ("urdf", '<joint name="jy" type="prismatic">', '<joint name="jy" type="fixed">', "AxisCount"),
    ("urdf", '<robot name="gantry">', '<robot name="gantry"><xacro:include filename="a"/>', "Xacro"),
    (
        "urdf",
        '<robot name="gantry">',
        '<robot name="gantry" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/>',
        "Xacro",
    ),
    ("urdf", 'xyz="0 0 0.5"', 'xyz="$(find gantry) 0 0"', "Xacro"),
    ("urdf", "</robot>", "", "NotUrdf"),
    ("urdf", '<link name="x"/>', f'<link name="x">{BOX.replace("0.1 0.1 0.1", "0.1 zwei")}</link>', "NumberUnreadable"),
    (
        "urdf",
        '<link name="x"/>',
        '<link name="x"><visual><geometry><mesh filename="package://a/b.stl"/></geometry></visual></link>',
        "PackagePath",
    ),
    (
        "urdf",
        '<link name="x"/>',
        '<link name="x"><visual><geometry><mesh filename="b.stl"/></geometry></visual></link>',
        "MeshMissing",
    ),
    ("urdf", '<link name="z"/>', f'<link name="z">{BOX}</link>', "HullSticksOut"),
    ("urdf", '<link name="y"/>', f'<link name="y">{BOX}</link>', "HullIncomplete"),
    ("toml", "[hull]", "[nothing]", "NoHull"),
    ("toml", 'source = "x"', 'source = " "', "NoSource"),
    ("toml", "home = [0.42, 0.0, -0.05]", "home = [0.42, 0.0, -0.8]", "HomeOutside"),
    ("toml", "home = [0.42, 0.0, -0.05]", "home = [0.42, 0.0, -0.45]", "HomeInCollision"),
    ("toml", "home = [0.42, 0.0, -0.05]", "home = [0.42, 0.0]", "NotLoadable"),
    ("toml", "workspace_low = [0.0, -0.5, 0.005]", "workspace_low = [0.0, -0.5, 0.69]", "WorkspaceUnreachable"),
    ("toml", "upper = [0.8, 0.5, 0.1]", "upper = [800, 0.5, 0.1]", "InMillimetres"),
    ("toml", "upper = [0.8, 0.5, 0.1]", "upper = [0.0, 0.5, 0.1]", "ZeroLimits"),
    ("toml", "values = [0.5,0.5,0.5]", "values = [0.0,0.5,0.5]", "ZeroLimits"),
    ("toml", "values = [0.5,0.5,0.5]", "values = [500,0.5,0.5]", "InMillimetres"),
    ("toml", "[limits.jerk]", "[limits.other]", "NoLimits"),
    ("toml", "[path]", "[path", "Unreadable"),
    ("toml", "home =", 'to_confirm = ["home"]\nhome =', "Unconfirmed"),
]


@pytest.mark.parametrize(("kind", "before", "after", "code"), ODD, ids=[f"{row[3]}-{k}" for k, row in enumerate(ODD)])
def test_what_is_odd_is_an_error_by_its_code_and_says_the_way_out(tmp_path, kind, before, after, code):
    found = [one for one in check_arm(folder(tmp_path, **{kind: (before, after)})) if one.code == code]
    assert found
    assert found[0].weight == "error"
    assert all(len(one.text) > 30 and one.where for one in found)


WARNED = [
    ("urdf", '<axis xyz="1 0 0"/>', '<axis xyz="2 0 0"/>', "AxisNotUnit"),
    ("urdf", '<limit lower="0" upper="0.8" velocity="0.5" effort="500"/>', "", "NoLimits"),
    ("urdf", 'lower="0" upper="0.8"', 'lower="0" upper="0.7"', "LimitsWider"),
    ("toml", 'source = "x"', 'source = "todo"', "NoSource"),
    ("toml", "radius = 0.0025", "radius = 0.025", "NeedleThick"),
    ("urdf", 'rpy="3.141592653589793 0 0"', 'rpy="0 0 0"', "NozzleUp"),
    ("toml", "workspace_high = [0.80, 0.5, 0.70]", "workspace_high = [0.80, 0.5, 0.2]", "HomeOutsideWorkspace"),
    ("toml", "part_frame = [0.42,", "part_frame = [0.92,", "PartUnreachable"),
]


@pytest.mark.parametrize(("kind", "before", "after", "code"), WARNED, ids=[row[3] for row in WARNED])
def test_what_somebody_should_look_at_is_a_warning_and_the_arm_can_be_used(tmp_path, kind, before, after, code):
    stem = folder(tmp_path, **{kind: (before, after)})
    assert code in codes(stem, "warning")
    assert not codes(stem)
    assert robots.read_files(stem).dof == 3


@settings(deadline=None, max_examples=12)
@given(st.data())
def test_what_passes_the_check_is_loaded_and_what_does_not_never_raises(tmp_path_factory, data):
    stem = folder(tmp_path_factory.mktemp("arm"))
    kind = data.draw(st.sampled_from(["urdf", "toml"]))
    file = stem.with_suffix(f".{kind}")
    content = bytearray(file.read_bytes())
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place : place + data.draw(st.integers(0, 12))] = data.draw(st.binary(max_size=6))
    file.write_bytes(bytes(content))
    if not codes(stem):
        assert robots.read_files(stem).dof >= 3


FINGERS = """
<!-- written out by xacro --><link name="left"/><link name="right"/>
<joint name="fl" type="prismatic"><parent link="z"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" velocity="0.1" effort="20"/></joint>
<joint name="fr" type="prismatic"><parent link="z"/><child link="right"/><axis xyz="0 -1 0"/><mimic joint="fl"/>
<limit lower="0" upper="0.04" velocity="0.1" effort="20"/></joint>
<transmission name="t"><joint name="jx"/><actuator name="m"/></transmission></robot>"""


async def test_fingers_beside_the_chain_are_told_and_stay_where_they_are(tmp_path):
    stem = folder(tmp_path, urdf=("</robot>", FINGERS))
    text = stem.with_suffix(".urdf").read_text()
    stem.with_suffix(".urdf").write_text(
        text.replace('<robot name="gantry">', '<robot name="gantry" xmlns:xacro="http://www.ros.org/wiki/xacro">')
    )
    assert not codes(stem)
    assert {"SeveralChains", "Mimic"} <= codes(stem, "warning")
    arm = PyBulletArm(robots.read_files(stem), realtime=False)
    await arm.open()
    try:
        trace = await arm.run(line_plan(arm.model, 0.03), lambda _: None)
    finally:
        await arm.close()
    assert trace.tracking_error()[1] < 5e-6


def test_encodings_are_told_and_a_byte_order_mark_is_no_hindrance(tmp_path):
    stem = folder(tmp_path)
    file = stem.with_suffix(".toml")
    text = file.read_text("utf-8")
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert "ByteOrderMark" in codes(stem, "note")
    assert not codes(stem)
    assert robots.read_files(stem).dof == 3
    for content in (text.encode("utf-16"), text.replace("generic", "Größe").encode("latin-1")):
        file.write_bytes(content)
        assert codes(stem) == {"Encoding"}


def test_a_folder_says_which_arms_it_holds_or_what_is_missing(tmp_path):
    assert [one.code for one in check_place(tmp_path)[tmp_path.name]] == ["FilesMissing"]
    (tmp_path / "cell.urdf.xacro").write_text("<robot/>")
    assert [one.code for one in check_place(tmp_path)[tmp_path.name]] == ["Xacro"]
    found = check_place(ROBOTS)
    assert set(found) == {"gantry", "gantry_c", "scara", "ur5e"}
    assert all("SeveralArms" in {one.code for one in rows} for rows in found.values())
    assert not any(one.weight == "error" for rows in found.values() for one in rows)


def test_shipped_arms_have_nothing_to_be_told_of(model, tmp_path):
    for kind in ("urdf", "toml"):
        shutil.copy(Path(robots.__file__).with_name(f"{model.name}.{kind}"), tmp_path)
    assert not [one for one in check_arm(tmp_path / model.name) if one.weight != "note"]


def test_a_loop_and_two_joints_to_one_link_are_refused_not_walked_for_ever(tmp_path):
    urdf_text, table = ((ROBOTS / f"gantry.{kind}").read_text("utf-8") for kind in ("urdf", "toml"))
    with pytest.raises(ValueError, match="go round in a circle"):
        robots.read_model("gantry", urdf_text.replace('<parent link="base"/>', '<parent link="z"/>'), table)
    again = '<joint name="again" type="fixed"><parent link="base"/><child link="x"/></joint></robot>'
    with pytest.raises(ValueError, match="hangs on two joints"):
        robots.read_model("gantry", urdf_text.replace("</robot>", again), table)
    with pytest.raises(ValueError, match="is no XML"):
        robots.read_model("gantry", urdf_text.replace("</robot>", ""), table)


Points = st.lists(st.tuples(*[st.floats(-0.5, 0.5)] * 3), min_size=4, max_size=30)


@settings(deadline=None, max_examples=5)
@given(Points)
def test_a_fitted_capsule_holds_every_point(points):
    cloud = np.array(points)
    found = fit("link", cloud)
    assert beyond(cloud, found.capsule).max() <= 0.0
    assert found.excess >= 0.0
    ball = 0.5 * math.sqrt(float(((cloud.max(axis=0) - cloud.min(axis=0)) ** 2).sum()))
    assert found.capsule.radius <= ball + 1e-3


def test_meshes_of_every_kind_say_the_same_points(tmp_path):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    faces = [(0, 1, 2), (1, 3, 2), (4, 5, 6), (5, 7, 6), (0, 1, 4)]
    triangles = corners[np.array(faces)]
    binary = b"solid but binary".ljust(80) + struct.pack("<I", len(faces))
    binary += b"".join(struct.pack("<12fH", 0, 0, 1, *one.reshape(-1), 0) for one in triangles)
    rows = [f"facet normal 0 0 1\nouter loop\n{_vertices(one)}\nendloop\nendfacet" for one in triangles]
    obj = "\n".join(f"v {x} {y} {z}" for x, y, z in corners)
    numbers = " ".join(str(1000.0 * one) for one in corners.reshape(-1))
    dae = (
        '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><asset><unit meter="0.001"/>'
        "<up_axis>Z_UP</up_axis></asset><library_geometries>"
        '<geometry id="g"><mesh><source id="p"><float_array>' + numbers + "</float_array>"
        '</source><vertices><input semantic="POSITION" source="#p"/></vertices></mesh></geometry></library_geometries>'
        "<library_visual_scenes><visual_scene><node><rotate>0 0 1 90</rotate><rotate>0 0 1 -90</rotate>"
        '<translate>0 0 0</translate><instance_geometry url="#g"/></node></visual_scene>'
        "</library_visual_scenes></COLLADA>"
    )
    written = {
        "a.stl": binary,
        "b.STL": ("solid a\n" + "\n".join(rows)).encode(),
        "c.obj": obj.encode(),
        "d.dae": dae.encode(),
    }
    for name, content in written.items():
        (tmp_path / name).write_bytes(content)
        found = np.unique(np.round(meshes.vertices(tmp_path / name), 9), axis=0)
        assert np.allclose(found, np.unique(corners, axis=0)), name
    for name, content in (("e.stl", binary[:200]), ("f.obj", b"v 1 zwei 3"), ("g.dae", b"<a>"), ("h.step", b"x")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(meshes.MeshRefused, match=r"export|save"):
            meshes.vertices(tmp_path / name)


def _vertices(triangle: np.ndarray) -> str:
    return "\n".join(f"vertex {x} {y} {z}" for x, y, z in triangle)


def test_round_shapes_are_within_their_points():
    for tag, inside in (
        ('<cylinder radius="0.1" length="0.4"/>', [[0.1, 0, 0.2], [0, -0.1, -0.2], [0.0707, 0.0707, 0.2]]),
        ('<sphere radius="0.2"/>', 0.2 * Rotation.random(60, rng=1).as_matrix()[:, 0]),
    ):
        text = f'<robot name="r"><link name="a"><collision><geometry>{tag}</geometry></collision></link></robot>'
        description, _ = urdf.read(text, "r.urdf")
        assert description is not None
        points = meshes.points_of(description.links[0].hull[0], ())
        capsule = fit("a", points).capsule
        assert beyond(np.array(inside), capsule).max() <= 0.0


SHAPED = {
    "ur5e": {"shoulder_link": '<cylinder radius="0.06" length="0.1"/>', "forearm_link": '<box size="0.1 0.1 0.1"/>'},
}


@pytest.mark.parametrize("name", SHAPED)
def test_a_described_arm_passes_the_check_once_it_is_confirmed_and_plans(tmp_path, name):
    text = (ROBOTS / f"{name}.urdf").read_text("utf-8")
    for link, shape in SHAPED[name].items():
        solid = f'<link name="{link}"><collision><geometry>{shape}</geometry></collision>'
        assert f'<link name="{link}"' in text
        text = text.replace(f'<link name="{link}">', solid)
    stem = tmp_path / name
    stem.with_suffix(".urdf").write_text(text)
    proposal = propose(text, name, tmp_path, needle=0.03)
    table = written(proposal)
    stem.with_suffix(".toml").write_text(table)
    assert codes(stem) == {"Unconfirmed"}
    assert robots.read_files(stem).unconfirmed == ("home", "limits", "path", "tool", "cell", "hull")
    confirmed = [line for line in table.splitlines() if not line.startswith("to_confirm")]
    stem.with_suffix(".toml").write_text("\n".join(confirmed))
    assert not codes(stem)
    model = robots.read_files(stem)
    assert len(model.capsules) == len(SHAPED[name]) + 1, "the shapes and the needle"
    assert plan_home(model, model.home).joints.shape[1] == model.dof


def elbow(length: float, soft: str = "") -> str:
    """Return the URDF of six axes like most arms have them, upper arm and forearm ``length`` m long."""
    joints = (
        ("0 0 1", (0.0, 0.0, 0.4), 2.8), ("0 1 0", (0.0, 0.0, 0.0), 1.9), ("0 1 0", (0.0, 0.0, length), 2.0),
        ("1 0 0", (length, 0.0, 0.0), 3.1), ("0 1 0", (0.0, 0.0, 0.0), 2.0), ("1 0 0", (0.08, 0.0, 0.0), 6.0),
    )  # fmt: skip
    text = '<robot name="elbow"><link name="l0"/>'
    for k, (axis, (x, y, z), most) in enumerate(joints, start=1):
        text += (
            f'<link name="l{k}"/><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<origin xyz="{x} {y} {z}"/><axis xyz="{axis}"/><limit lower="{-most}" upper="{most}" velocity="2"/>'
            f"{soft if k == 3 else ''}</joint>"
        )
    tip = '<link name="tip"/><joint name="to_tip" type="fixed"><parent link="l6"/><child link="tip"/>'
    return f'{text}{tip}<origin xyz="0.1 0 0" rpy="0 1.5707963 0"/></joint></robot>'


@pytest.mark.parametrize("length", [0.3, 0.8])
def test_a_proposed_workspace_has_room_for_a_plate_where_the_part_is(tmp_path, length):
    model = propose(elbow(length), "elbow", tmp_path, needle=0.12).model
    low, high = np.array(model.workspace_low), np.array(model.workspace_high)
    assert (high - low)[:2].min() > 0.5 * length, "a good part of what it reaches, whichever way is looked first"
    assert (low <= model.part_frame[:3]).all() and (np.array(model.part_frame[:3]) <= high).all()


def test_soft_limits_are_kept_and_told(tmp_path):
    soft = '<safety_controller soft_lower_limit="-1.5" soft_upper_limit="1.2" k_velocity="1"/>'
    made = propose(elbow(0.4, soft), "elbow", tmp_path)
    assert (made.model.limits.lower[2], made.model.limits.upper[2]) == (-1.5, 1.2)
    assert "j3 by safety_controller" in made.sources["position"]
    without = propose(elbow(0.4, '<safety_controller k_velocity="1"/>'), "elbow", tmp_path)
    assert (without.model.limits.lower[2], without.model.limits.upper[2]) == (-2.0, 2.0)


def test_a_description_that_cannot_be_read_is_not_guessed_at(tmp_path):
    text = (ROBOTS / "gantry.urdf").read_text("utf-8").replace('type="prismatic"', 'type="planar"', 1)
    with pytest.raises(NotDescribable) as refused:
        propose(text, "gantry", tmp_path)
    assert "JointType" in {one.code for one in refused.value.findings}


def poses(offset: np.ndarray, count: int, seed: int, spread: float = 0.6) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(random.uniform(-spread, spread, (count, 3))).as_matrix()
    return np.array([0.4, 0.1, 0.2]) - turns @ offset, turns


@settings(deadline=None, max_examples=30)
@given(st.integers(4, 12), st.integers(0, 1000))
def test_a_tip_held_on_one_point_is_found_exactly_and_noise_is_the_residual(count, seed):
    offset = np.array([0.01, -0.02, 0.15])
    positions, turns = poses(offset, count, seed)
    try:
        found = tool_point(positions, turns)
    except PosesRefused:
        return
    assert np.abs(found.offset - offset).max() < 1e-9
    assert np.abs(found.point - [0.4, 0.1, 0.2]).max() < 1e-9
    noisy = tool_point(positions + np.random.default_rng(seed).normal(0.0, 1e-4, positions.shape), turns)
    assert 0.0 < noisy.rms < 5e-4


def test_poses_that_do_not_tell_are_refused():
    offset = np.array([0.0, 0.0, 0.1])
    with pytest.raises(PosesRefused, match="at least 4"):
        tool_point(*poses(offset, 3, 1))
    with pytest.raises(PosesRefused, match="turned by"):
        tool_point(*poses(offset, 6, 1, spread=0.01))
    turns = Rotation.from_rotvec(np.linspace(0.0, 2.0, 6)[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    with pytest.raises(PosesRefused, match="one axis only"):
        tool_point(np.zeros(3) - turns @ offset, turns)


TOOLS = """
[[tools]]
name = "long needle"
tip = "z"
offset = [0.0, 0.0, -0.2]
turn = [3.141592653589793, 0.0, 0.0]
mass = 0.3
length = 0.2
residual = 0.00004
"""


def test_an_arm_carries_another_of_its_tools(tmp_path):
    stem = folder(tmp_path)
    stem.with_suffix(".toml").write_text(stem.with_suffix(".toml").read_text() + TOOLS)
    assert not codes(stem)
    model = robots.read_files(stem)
    assert (model.tools[0].residual, model.tool.length) == (0.00004, 0.12)
    carrying = robots.changed(model, robots.Changes(tool="long needle"))
    assert (carrying.tool.name, carrying.tool.length) == ("long needle", 0.2)
    assert carrying.digest != model.digest
    from sim.planning.kinematics import kinematics

    lower = kinematics(carrying).seed_position - kinematics(model).seed_position
    assert np.allclose(lower, [0.0, 0.0, -0.08])
    with pytest.raises(ValueError, match="names long needle"):
        robots.changed(model, robots.Changes(tool="short"))
    broken = replace(model, tools=(replace(model.tools[0], tip="x"),))
    with pytest.raises(ValueError, match="before its last moving joint"):
        robots.changed(broken, robots.Changes(tool="long needle"))


def test_a_limits_file_can_place_the_tip_itself(tmp_path):
    stem = folder(tmp_path, toml=("length = 0.12", "length = 0.17\noffset = [0.0, 0.0, 0.05]"))
    from sim.planning.kinematics import kinematics

    model = robots.read_files(stem)
    assert np.allclose(kinematics(own_arm("gantry")).seed_position - kinematics(model).seed_position, [0, 0, 0.05])
    assert model.tool.length == 0.17

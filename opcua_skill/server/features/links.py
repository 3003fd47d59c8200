"""An arm's links under `Machines/<Workstation>/Equipment/Arm`: enough to draw it for any joints, in flat arrays."""

from asyncua import ua
from scipy.spatial.transform import Rotation

from opcua_skill.server.address_space import Tree, numbers, texts
from sim.arm_model import ArmModel
from sim.planning.kinematics import kinematics

NONE = (0.0, 0.0, 0.0)


def add_links(tree: Tree, place: str, arm: ua.NodeId, model: ArmModel) -> None:
    """Add the links from the base outwards, how each stands on the one before, and the capsules that cover them."""
    joints = kinematics(model).joints
    names = [joint.child for joint in joints]
    origins = [value for joint in joints for value in (*joint.offset, *Rotation.from_matrix(joint.rotation).as_quat())]
    axes = [value for joint in joints for value in (NONE if joint.axis is None else joint.axis)]
    capsules = [
        value
        for one in model.capsules
        for value in (names.index(one.link) if one.link in names else -1, *one.start, *one.end, one.radius)
    ]
    for label, values, said in (
        ("LinkNames", texts(names), "the links from the base to the nozzle's tip, without the base"),
        ("LinkOrigins", numbers(origins), "x y z (m) qx qy qz qw a link: its frame in the one before, joint at 0"),
        ("LinkAxes", numbers(axes), "x y z a link: the axis in its frame about which it turns; 0 0 0: it is fixed"),
        ("LinkCapsules", numbers(capsules), "link (-1: base) x y z x y z radius (m) a capsule: ends in its link"),
    ):
        tree.property(f"{place}/{label}", arm, values, description=said)

"""`Machines/<Workstation>/Arm/GoHome` and `StopMotion`."""

from opcua_skill.methods.homing import HomingMethods
from opcua_skill.nodes.library import COMMENT, OPERATORS, method
from opcua_skill.nodes.tree import Tree
from opcua_skill.stack.calls import add_method


async def add_homing(tree: Tree, workstation: str, methods: HomingMethods) -> None:
    """Add the methods to the arm of a workstation."""
    arm = f"Machines/{workstation}/Arm"
    for spec in (
        method("GoHome", methods.go_home, OPERATORS, (COMMENT,), ()),
        method("StopMotion", methods.stop_motion, OPERATORS, (COMMENT,), (), urgent=True),
    ):
        tree.declare_method("ArmType", spec)
        await add_method(tree.server, tree.id(arm), spec, tree.id(f"{arm}/{spec.name}"), tree.name(spec.name))

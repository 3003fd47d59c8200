"""`Machines/<Workstation>/CheckRun`."""

from opcua_skill.methods.checking import CheckingMethods
from opcua_skill.nodes.library import OPERATORS, method
from opcua_skill.nodes.tree import Tree
from opcua_skill.nodes.types import BOOLEAN, DOUBLE, STRING, UINT32
from opcua_skill.stack.calls import Argument, add_method


async def add_checking(tree: Tree, workstation: str, methods: CheckingMethods) -> None:
    """Add the method to a workstation."""
    place = f"Machines/{workstation}"
    spec = method(
        "CheckRun",
        methods.check_run,
        OPERATORS,
        (
            Argument("Recipe", tree.type_id("RecipeDataType"), description="stored or not"),
            Argument("SkillVersion", UINT32, description="0: the one that a simulation would run"),
        ),
        (
            Argument("SkillVersion", UINT32, description="the version that was looked at"),
            Argument("CanRun", BOOLEAN, description="false: the findings say why not"),
            Argument("Report", STRING, description="JSON: findings, modes, plan digest, speeds, lengths, plate, valve"),
            Argument("Times", DOUBLE, 1, "s since the start of the path, thinned"),
            Argument("Positions", DOUBLE, 1, "nozzle tip x y z in m in the part's frame, row-major"),
            Argument("Speeds", DOUBLE, 1, "of the nozzle, m/s"),
            Argument("Dispense", BOOLEAN, 1, "valve open, lead included"),
            Argument("Covariances", DOUBLE, 1, "of the people, 3 x 3 a sample, m2, row-major"),
        ),
        changes=False,
        seconds=70.0,
    )
    tree.declare_method("WorkstationType", spec)
    await add_method(tree.server, tree.id(place), spec, tree.id(f"{place}/{spec.name}"), tree.name(spec.name))

"""`SkillLibrary/LearnAgain`: edits of recordings as a client sees them."""

from opcua_skill.methods.edits import EditMethods
from opcua_skill.nodes.library import COMMENT, JOB_ID, PATH, SKILL, STATE, TEACHERS, VERSION, method
from opcua_skill.nodes.tree import Tree
from opcua_skill.nodes.types import UINT32
from opcua_skill.stack.calls import Argument, add_method


async def add_edits(tree: Tree, methods: EditMethods) -> None:
    """Add the method to the library."""
    edits = Argument("Edits", tree.type_id("DemonstrationEditsDataType"), 1, "recordings without an entry are whole")
    version = Argument("SkillVersion", UINT32, description="0 while the job goes on")
    spec = method(
        "LearnAgain",
        methods.learn_again,
        TEACHERS,
        (SKILL, VERSION, edits, COMMENT),
        (JOB_ID, STATE, version),
    )
    tree.declare_method("SkillLibraryType", spec)
    await add_method(tree.server, tree.id(PATH), spec, tree.id(f"{PATH}/{spec.name}"), tree.name(spec.name))

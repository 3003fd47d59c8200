"""`SkillLibrary/GetAuditTrail`: the audit trail as a client reads it."""

from opcua_skill.methods.audit import AuditMethods
from opcua_skill.nodes.library import ENGINEERS, PATH, method
from opcua_skill.nodes.tree import Tree
from opcua_skill.nodes.types import UINT32, UINT64
from opcua_skill.stack.calls import Argument, add_method


async def add_audit(tree: Tree, methods: AuditMethods) -> None:
    """Add the method to the library."""
    spec = method(
        "GetAuditTrail",
        methods.get_audit_trail,
        ENGINEERS,
        (
            Argument("Before", UINT64, description="only entries older than the one of this id; 0: the newest"),
            Argument("Limit", UINT32, description="0: 100; at most 1000"),
        ),
        (Argument("Entries", tree.type_id("AuditEntryDataType"), 1, "the newest first"),),
        changes=False,
    )
    tree.declare_method("SkillLibraryType", spec)
    await add_method(tree.server, tree.id(PATH), spec, tree.id(f"{PATH}/{spec.name}"), tree.name(spec.name))

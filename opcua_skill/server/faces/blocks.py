"""`MachineryBuildingBlocks` of a workstation, where every face of OPC 40001 hangs its own."""

from asyncua import ua
from asyncua.ua.object_ids import ObjectIds

from opcua_skill.server.address_space import Tree, standard
from opcua_skill.server.nodesets import MACHINERY


def building_blocks(tree: Tree, workstation: str) -> ua.NodeId:
    """Return the folder, which the first face that asks for it adds; the name plate is one of its blocks."""
    machine = f"Machines/{workstation}"
    path = f"{machine}/MachineryBuildingBlocks"
    folder = tree.id(path)
    if folder not in tree.server.iserver.aspace:
        tree.object(
            path,
            tree.id(machine),
            name=tree.name("MachineryBuildingBlocks", MACHINERY),
            type_definition=standard(ObjectIds.FolderType),
            description="what this machine offers in the words of OPC 40001",
        )
        tree.reference(folder, tree.id(f"{machine}/Identification"), ObjectIds.HasAddIn, ua.NodeClass.Object)
    return folder

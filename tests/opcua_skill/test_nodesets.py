"""Companion specifications are imported as asyncua itself would import them."""

import logging
from dataclasses import fields

import pytest
from asyncua import ua
from asyncua.server.server import Server

from opcua_skill.server.nodesets import NEEDED, Importer, node_set
from opcua_skill.stack.address_space.values import node_id


def references(server: Server) -> dict[str, list[str]]:
    """Return what every node refers to."""
    space = server.iserver.aspace
    nodes = space.keys()
    return {str(node): sorted(map(repr, space[node].references)) for node in nodes}


async def test_nodes_refer_to_each_other_as_if_asyncua_had_imported_them(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.CRITICAL, "asyncua")
    ours, theirs = Server(), Server()
    for server in (ours, theirs):
        await server.init()
    await Importer(ours).import_xml(xmlstring=node_set("di"))
    await theirs.import_xml(xmlstring=node_set("di"))
    assert references(ours) == references(theirs)


async def test_results_are_imported_although_a_type_has_a_structure_within_a_structure_as_its_value() -> None:
    server = Server()
    await server.init()
    for name in (*NEEDED, "machinery_result"):
        await Importer(server).import_xml(xmlstring=node_set(name))
    index = await server.get_namespace_index("http://opcfoundation.org/UA/Machinery/Result/")
    names = {number: (await server.get_node(node_id(number, index)).read_browse_name()).Name for number in (1004, 2001)}
    assert names == {1004: "ResultManagementType", 2001: "ResultType"}
    told = ua.extension_objects_by_datatype[node_id(3006, index)]
    assert {"StartTime", "EndTime"} <= {one.name for one in fields(told)}

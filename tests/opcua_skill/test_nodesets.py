"""Companion specifications are imported as asyncua itself would import them."""

import logging

import pytest
from asyncua.server.server import Server

from opcua_skill.nodes.nodesets import Importer, node_set


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

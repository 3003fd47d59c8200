"""Node sets imported into our own address space: what is there is looked up, not browsed for."""

from typing import Any

from asyncua import ua
from asyncua.common.xmlimporter import XmlImporter
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.stack.values import node_id

ONE_WAY = frozenset(
    node_id(kind)
    for kind in (
        Ids.GuardVariableType,
        Ids.HasGuard,
        Ids.TransitionVariableType,
        Ids.StateMachineType,
        Ids.StateVariableType,
        Ids.TwoStateVariableType,
        Ids.StateType,
        Ids.TransitionType,
        Ids.FiniteTransitionVariableType,
        Ids.HasInterface,
    )
)
"""What asyncua adds no way back for."""


async def import_node_set(server: Any, xml: str) -> None:
    """Import a node set; its own slips are logged by asyncua."""
    await _Importer(server, strict_mode=True, auto_load_definitions=True).import_xml(xmlstring=xml)


class _Importer(XmlImporter):
    """asyncua's importer, which browses each new node for references that have no way back: half of an import."""

    async def _add_missing_reverse_references(self, new_nodes: list[Any]) -> set[Any]:
        aspace = self.session.iserver.aspace
        without, known, forward = set(new_nodes), set(), []
        for source in new_nodes:
            for one in aspace[source].references:
                without.discard(source)
                without.discard(one.NodeId)
                if one.ReferenceTypeId not in ONE_WAY:
                    known.add((source, one.NodeId, one.ReferenceTypeId))
                    forward.append((source, one))
        back = [
            ua.AddReferencesItem(
                SourceNodeId=one.NodeId,
                TargetNodeId=source,
                ReferenceTypeId=one.ReferenceTypeId,
                IsForward=not one.IsForward,
            )
            for source, one in forward
            if (one.NodeId, source, one.ReferenceTypeId) not in known
        ]
        await self._add_references(back)
        return without

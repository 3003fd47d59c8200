"""The standard nodes as this server has them: what it does not do is gone, what is left has its value."""

import time
from datetime import UTC, datetime
from typing import Any

from asyncua import ua
from asyncua.server.address_space import AddressSpace
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.stack.address_space.values import node_id

_GONE = (
    Ids.Server_UrisVersion,
    Ids.Server_EstimatedReturnTime,
    Ids.Server_SetSubscriptionDurable,
    Ids.Server_RequestServerStateChange,
    Ids.Server_ServerRedundancy_RedundantServerArray,
    Ids.Server_ServerCapabilities_RoleSet,
    Ids.HistoryServerCapabilities,
    Ids.OPCUANamespaceMetadata_DefaultRolePermissions,
    Ids.OPCUANamespaceMetadata_DefaultUserRolePermissions,
    Ids.OPCUANamespaceMetadata_DefaultAccessRestrictions,
    Ids.ServerConfiguration,
    Ids.PublishSubscribe,
    Ids.Dictionaries,
    Ids.DefaultHAConfiguration,
    Ids.DefaultHEConfiguration,
    Ids.Aliases,
    Ids.Locations,
    Ids.Resources,
    Ids.Quantities,
    Ids.ServerLog,
    Ids.Server_ServerCapabilities_ConformanceUnits,
)
"""Objects, variables and methods that stand for what this server does not offer; all of them optional."""

_PARTS = frozenset(node_id(kind) for kind in (Ids.HasComponent, Ids.HasProperty, Ids.HasOrderedComponent, Ids.HasAddIn))
_RULES = (Ids.ModellingRule_Mandatory, Ids.ModellingRule_Optional)
_T = ua.VariantType


def take_away(aspace: AddressSpace, roots: tuple[int, ...] = _GONE) -> None:
    """Take nodes away with all their parts, and every reference to them, in one go over the address space."""
    gone = {node_id(root) for root in roots} & set(aspace.keys())
    waiting = list(gone)
    while waiting:
        parts = {r.NodeId for r in aspace[waiting.pop()].references if r.IsForward and r.ReferenceTypeId in _PARTS}
        found = {part for part in parts - gone if part in aspace and _owned_by(aspace, part, gone)}
        gone |= found
        waiting += found
    for node in gone:
        del aspace[node]
    for node in aspace._nodes.values():
        if any(reference.NodeId in gone for reference in node.references):
            node.references = [reference for reference in node.references if reference.NodeId not in gone]


def _owned_by(aspace: AddressSpace, part: ua.NodeId, gone: set[ua.NodeId]) -> bool:
    """Return whether a part belongs to nothing that stays."""
    owners = {r.NodeId for r in aspace[part].references if not r.IsForward and r.ReferenceTypeId in _PARTS}
    return owners <= gone


def list_modelling_rules(iserver: Any) -> None:
    """Put the rules that types of this server use where clients look for them."""
    for rule in _RULES:
        item = ua.AddReferencesItem(ReferenceTypeId=node_id(Ids.HasComponent), TargetNodeClass=ua.NodeClass.Object)
        item.SourceNodeId = node_id(Ids.Server_ServerCapabilities_ModellingRules)
        item.TargetNodeId, item.IsForward = node_id(rule), True  # pyright: ignore[reportAttributeAccessIssue]
        iserver.node_mgt_service.add_references([item])[0].check()


def standard_values() -> dict[int, ua.Variant]:
    """Return the values of standard variables that do not follow from limits: no redundancy, nothing certified."""
    return {
        Ids.Server_ServerRedundancy_RedundancySupport: ua.Variant(int(ua.RedundancySupport.None_), _T.Int32),
        Ids.Server_ServerCapabilities_SoftwareCertificates: ua.Variant([], _T.ExtensionObject, is_array=True),
        Ids.OPCUANamespaceMetadata_StaticStringNodeIdPattern: ua.Variant("", _T.String),
    }


def tell_local_time(aspace: AddressSpace) -> None:
    """Have the server's time zone told as it is when it is read."""

    def now(node: ua.NodeId, attribute: AttributeIds) -> ua.DataValue:
        moment: Any = datetime.now(UTC)
        zone = ua.Variant(time_zone(moment), _T.ExtensionObject)
        return ua.DataValue(zone, SourceTimestamp=moment, ServerTimestamp=moment)

    aspace.set_attribute_value_callback(node_id(Ids.Server_LocalTime), AttributeIds.Value, now)


def time_zone(moment: datetime) -> ua.TimeZoneDataType:
    """Return how the server's clock on the wall stands to UTC."""
    local = time.localtime(moment.timestamp())
    return ua.TimeZoneDataType(Offset=ua.Int16(local.tm_gmtoff // 60), DaylightSavingInOffset=local.tm_isdst > 0)

"""Questions about the type hierarchy, answered from the address space without a service call."""

from collections.abc import Iterator

from asyncua import ua
from asyncua.server.address_space import AddressSpace
from asyncua.ua.object_ids import ObjectIds as Ids

from opcua_skill.stack.address_space.values import SERVER, node_id

_HAS_SUBTYPE = node_id(Ids.HasSubtype)
_NOTIFIES = (node_id(Ids.HasEventSource), node_id(Ids.HasNotifier))


def supertypes(aspace: AddressSpace, node_id: ua.NodeId) -> Iterator[ua.NodeId]:
    """Yield a type and all types above it, the nearest first."""
    seen: set[ua.NodeId] = set()
    at: ua.NodeId | None = node_id
    while at is not None and at not in seen:
        seen.add(at)
        yield at
        node = aspace.get(at)
        above = (
            [r.NodeId for r in node.references if r.ReferenceTypeId == _HAS_SUBTYPE and not r.IsForward] if node else []
        )
        at = above[0] if above else None


def subtypes(aspace: AddressSpace, of: ua.NodeId) -> Iterator[ua.NodeId]:
    """Yield a type and all types below it."""
    seen, waiting = set[ua.NodeId](), [of]
    while waiting:
        at = waiting.pop()
        if at in seen:
            continue
        seen.add(at)
        yield at
        node = aspace.get(at)
        waiting += (
            [r.NodeId for r in node.references if r.ReferenceTypeId == _HAS_SUBTYPE and r.IsForward] if node else []
        )


def is_subtype(aspace: AddressSpace, node_id: ua.NodeId, of: ua.NodeId) -> bool:
    """Return whether a type is another one or a subtype of it."""
    return any(found == of for found in supertypes(aspace, node_id))


def notifiers(aspace: AddressSpace, node_id: ua.NodeId) -> list[ua.NodeId]:
    """Return the nodes whose subscribers hear an event of this node: itself, its notifiers upwards, and the Server."""
    found, waiting = [], [node_id]
    while waiting:
        at = waiting.pop(0)
        if at in found:
            continue
        found.append(at)
        node = aspace.get(at)
        if node is not None:
            waiting += [r.NodeId for r in node.references if r.ReferenceTypeId in _NOTIFIES and not r.IsForward]
    if SERVER not in found:
        found.append(SERVER)
    return found

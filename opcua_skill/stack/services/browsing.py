"""Browse in pages, with BrowseNext, and paths: what is visited and answered is bounded, and others get their turn."""

import asyncio
import dataclasses
import functools
import secrets
from collections import OrderedDict
from typing import Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.address_space.values import node_id, status
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.operations import attempted, refused

_HAS_SUBTYPE = node_id(Ids.HasSubtype)
VISITS_BETWEEN_TURNS = 2_000
NO_REMAINING_PATH = 0xFFFF_FFFF
_BLANK: tuple[tuple[str, Any], ...] = (  # in the order of BrowseResultMask
    ("ReferenceTypeId", ua.NodeId()),
    ("IsForward", False),
    ("NodeClass", ua.NodeClass.Unspecified),
    ("BrowseName", ua.QualifiedName()),
    ("DisplayName", ua.LocalizedText()),
    ("TypeDefinition", ua.NodeId()),
)
References = list[ua.ReferenceDescription]


class Browser:
    """The browse services of one session, which keeps the rest of a long answer as a continuation point."""

    def __init__(self, aspace: AddressSpace, limits: Limits) -> None:
        self._aspace = aspace
        self._limits = limits
        self._rest: OrderedDict[bytes, tuple[References, int]] = OrderedDict()

    async def browse(self, params: ua.BrowseParameters) -> list[ua.BrowseResult]:
        """Return one result for each node, the first page of it."""
        if params.View is not None and not params.View.ViewId.is_null():
            raise ServiceError(Codes.BadViewIdUnknown)
        wanted = int(params.RequestedMaxReferencesPerNode or 0) or self._limits.references_per_browse
        page, turn = min(wanted, self._limits.references_per_browse), _Turn(self._aspace)
        budget, results = self._limits.references_per_request, []
        for description in params.NodesToBrowse:
            result = ua.BrowseResult()
            code, found = await attempted(
                lambda description=description: turn.references(description), lambda code: (code, []), "Browse"
            )
            result.StatusCode = status(code)
            if not code:
                size = min(page, max(budget, 0))
                self._fill(result, found, size, page)
                budget -= len(result.References)
            results.append(result)
        return results

    async def browse_next(self, params: ua.BrowseNextParameters) -> list[ua.BrowseResult]:
        """Return the next page of each continuation point, or release them and return nothing."""
        if params.ReleaseContinuationPoints:
            for point in params.ContinuationPoints:
                self._rest.pop(bytes(point or b""), None)
            return []
        results, budget = [], self._limits.references_per_request
        for point in params.ContinuationPoints:
            result = ua.BrowseResult()
            kept = self._rest.pop(bytes(point or b""), None)
            if kept is None:
                result.StatusCode = status(Codes.BadContinuationPointInvalid)
            else:
                found, page = kept
                self._fill(result, found, min(page, max(budget, 0)), page)
                budget -= len(result.References)
            results.append(result)
        return results

    def _fill(self, result: ua.BrowseResult, found: References, size: int, page: int) -> None:
        """Put a page into a result and keep the rest; when too many rests are kept already, there is no page either."""
        rest = found[size:]
        if rest and len(self._rest) >= self._limits.continuation_points:
            result.StatusCode = status(Codes.BadNoContinuationPoints)
            return
        result.References = found[:size]
        if rest:
            point = secrets.token_bytes(16)
            self._rest[point] = (rest, page)
            result.ContinuationPoint = point  # pyright: ignore[reportAttributeAccessIssue]

    async def translate(self, paths: list[ua.BrowsePath]) -> list[ua.BrowsePathResult]:
        """Return the nodes that each path of names leads to."""
        turn = _Turn(self._aspace)
        no_path = functools.partial(refused, ua.BrowsePathResult)
        return [await attempted(lambda path=path: self._follow(turn, path), no_path, "path") for path in paths]

    async def _follow(self, turn: "_Turn", path: ua.BrowsePath) -> ua.BrowsePathResult:
        result = ua.BrowsePathResult()
        elements = path.RelativePath.Elements
        if not elements:
            result.StatusCode = status(Codes.BadNothingToDo)
        elif len(elements) > self._limits.path_elements:
            result.StatusCode = status(Codes.BadQueryTooComplex)
        elif any(not one.TargetName or not one.TargetName.Name for one in elements):
            result.StatusCode = status(Codes.BadBrowseNameInvalid)
        elif path.StartingNode not in self._aspace:
            result.StatusCode = status(Codes.BadNodeIdUnknown)
        else:
            found = await turn.follow(path.StartingNode, elements)
            result.StatusCode = status(Codes.Good if found else Codes.BadNoMatch)
            result.Targets = [_target(node) for node in found]
        return result


class _Turn:
    """One request's walk over the address space: reference types looked up once, a pause now and then for others."""

    def __init__(self, aspace: AddressSpace) -> None:
        self._aspace = aspace
        self._subtypes: dict[ua.NodeId, frozenset[ua.NodeId]] = {}
        self._visits = 0

    async def _visit(self, count: int) -> None:
        self._visits += count + 10
        if self._visits > VISITS_BETWEEN_TURNS:
            self._visits = 0
            await asyncio.sleep(0)

    def _kinds(self, reference_type: ua.NodeId, subtypes: bool) -> frozenset[ua.NodeId] | None:
        """Return the reference types that match, None for all."""
        if reference_type.is_null():
            return None
        if not subtypes:
            return frozenset({reference_type})
        if reference_type not in self._subtypes:
            found, waiting = set[ua.NodeId](), [reference_type]
            while waiting:
                at = waiting.pop()
                node = self._aspace.get(at)
                if at in found or node is None:
                    continue
                found.add(at)
                waiting += [r.NodeId for r in node.references if r.ReferenceTypeId == _HAS_SUBTYPE and r.IsForward]
            self._subtypes[reference_type] = frozenset(found)
        return self._subtypes[reference_type]

    async def references(self, wanted: ua.BrowseDescription) -> tuple[int, References]:
        """Return a status code and the references of one node that match."""
        node = self._aspace.get(wanted.NodeId)
        if node is None:
            return Codes.BadNodeIdUnknown, []
        direction = wanted.BrowseDirection
        if direction not in {ua.BrowseDirection.Forward, ua.BrowseDirection.Inverse, ua.BrowseDirection.Both}:
            return Codes.BadBrowseDirectionInvalid, []
        if not wanted.ReferenceTypeId.is_null() and not self._is_reference_type(wanted.ReferenceTypeId):
            return Codes.BadReferenceTypeIdInvalid, []
        await self._visit(len(node.references))
        kinds = self._kinds(wanted.ReferenceTypeId, wanted.IncludeSubtypes)
        either = direction == ua.BrowseDirection.Both
        forward, mask = direction == ua.BrowseDirection.Forward, int(wanted.NodeClassMask)
        found = [
            reference
            for reference in node.references
            if (either or reference.IsForward == forward)
            and (kinds is None or reference.ReferenceTypeId in kinds)
            and (not mask or mask & int(reference.NodeClass))
        ]
        left_out = _left_out(int(wanted.ResultMask))
        return Codes.Good, [dataclasses.replace(one, **left_out) for one in found] if left_out else found

    def _is_reference_type(self, reference_type: ua.NodeId) -> bool:
        node = self._aspace.get(reference_type)
        if node is None:
            return False
        told = node.attributes[AttributeIds.NodeClass].value
        return told is not None and told.Value is not None and told.Value.Value == ua.NodeClass.ReferenceType

    async def follow(self, start: ua.NodeId, elements: list[ua.RelativePathElement]) -> list[ua.NodeId]:
        """Return the nodes a path leads to, each once."""
        at = [start]
        for element in elements:
            kinds = self._kinds(element.ReferenceTypeId, bool(element.IncludeSubtypes))
            found: dict[ua.NodeId, None] = {}
            for here in at:
                node = self._aspace.get(here)
                if node is None:
                    continue
                await self._visit(len(node.references))
                for reference in node.references:
                    if (
                        reference.IsForward != element.IsInverse
                        and reference.BrowseName == element.TargetName
                        and (kinds is None or reference.ReferenceTypeId in kinds)
                    ):
                        found[reference.NodeId] = None
            at = list(found)
        return at


@functools.cache
def _left_out(mask: int) -> dict[str, Any]:
    """Return the fields of a reference that a result mask does not ask for, each with what stands for nothing."""
    return {name: blank for bit, (name, blank) in enumerate(_BLANK) if not mask >> bit & 1}


def _target(node: ua.NodeId) -> ua.BrowsePathTarget:
    target = ua.BrowsePathTarget()
    target.TargetId = node  # pyright: ignore[reportAttributeAccessIssue] - a NodeId of this server is an expanded one
    target.RemainingPathIndex = NO_REMAINING_PATH  # pyright: ignore[reportAttributeAccessIssue]
    return target

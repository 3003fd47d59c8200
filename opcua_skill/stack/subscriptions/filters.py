"""What a client may ask of events: filters that know type hierarchies, looked at whole before they are taken."""

import dataclasses
import logging
from collections.abc import Hashable
from typing import Any

from asyncua import ua
from asyncua.server.monitored_item_service import WhereClauseEvaluator
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.address_space.types import is_subtype, subtypes, supertypes
from opcua_skill.stack.address_space.values import node_id, status
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.index_ranges import index_range

log = logging.getLogger(__name__)

_DOES_NOT_FIT = (AttributeError, LookupError, TypeError, ValueError, NotImplementedError, RecursionError)
_OPERANDS = (ua.ElementOperand, ua.LiteralOperand, ua.AttributeOperand, ua.SimpleAttributeOperand)
_WORKING = {
    ua.FilterOperator.Equals: 2,
    ua.FilterOperator.IsNull: 1,
    ua.FilterOperator.GreaterThan: 2,
    ua.FilterOperator.LessThan: 2,
    ua.FilterOperator.GreaterThanOrEqual: 2,
    ua.FilterOperator.LessThanOrEqual: 2,
    ua.FilterOperator.Not: 1,
    ua.FilterOperator.Between: 3,
    ua.FilterOperator.InList: 2,
    ua.FilterOperator.And: 2,
    ua.FilterOperator.Or: 2,
    ua.FilterOperator.OfType: 1,
}


_BASE = node_id(Ids.BaseEventType)
_MEMBERS = frozenset({node_id(Ids.HasProperty), node_id(Ids.HasComponent)})
_ATTRIBUTES = frozenset(AttributeIds)
_NOTHING = ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName("")])
_SELECTS_NOTHING = frozenset({Codes.BadAttributeIdInvalid, Codes.BadIndexRangeInvalid})


class EventFilter(WhereClauseEvaluator):
    """A where-clause whose OfType also holds for subtypes, and whose faults say no without a traceback.

    The literals of each list are gone through once, when the filter is made, not with each event.
    """

    def __init__(self, logger: logging.Logger, aspace: Any, whereclause: ua.ContentFilter) -> None:
        super().__init__(logger, aspace, whereclause)
        lists = (e.FilterOperands[1:] if e.FilterOperator == ua.FilterOperator.InList else [] for e in self.elements)
        self._lists = [_split(operands) for operands in lists]

    def eval(self, event: Any) -> bool:
        """Return whether the event passes; an event that lacks a field the clause asks for does not."""
        if not self.elements:
            return True
        try:
            return bool(self._eval_el(0, event))
        except _DOES_NOT_FIT as error:
            log.info("an event filter does not fit an event: %s", type(error).__name__)
            return False

    def _eval_el(self, index: int, event: Any) -> Any:
        element = self.elements[index]
        if element.FilterOperator == ua.FilterOperator.OfType:
            wanted = self._eval_op(element.FilterOperands[0], event)
            return isinstance(wanted, ua.NodeId) and is_subtype(self._aspace, event.EventType, wanted)
        if element.FilterOperator == ua.FilterOperator.InList:
            wanted, (literals, others) = self._eval_op(element.FilterOperands[0], event), self._lists[index]
            return _key(wanted) in literals or any(wanted == self._eval_op(one, event) for one in others)
        return super()._eval_el(index, event)

    def _eval_op(self, op: Any, event: Any) -> Any:
        if isinstance(op, ua.SimpleAttributeOperand) and op.BrowsePath:
            return getattr(event, "/".join(part.Name or "" for part in op.BrowsePath), None)
        return super()._eval_op(op, event)


def _split(operands: list[Any]) -> tuple[frozenset[Any], list[Any]]:
    """Return the values of the literals of a list, and the operands that have to be worked out for each event."""
    literals = [one for one in operands if isinstance(one, ua.LiteralOperand)]
    values = frozenset(_key(one.Value.Value if one.Value is not None else None) for one in literals)
    return values, [one for one in operands if not isinstance(one, ua.LiteralOperand)]


def _key(value: Any) -> Any:
    """Return what stands for a value among others; what cannot be hashed is known by how it is written."""
    return value if isinstance(value, Hashable) else repr(value)


class FilterLooked:
    """An event filter as it was looked at: the code it comes to, and a code for each clause, element and operand."""

    def __init__(self, wanted: Any, limits: Limits, aspace: Any) -> None:
        self.code: int = Codes.BadEventFilterInvalid
        self.result: ua.EventFilterResult | None = None
        self.select: list[ua.SimpleAttributeOperand] = []
        self._fields = _Fields(aspace)
        if not isinstance(wanted, ua.EventFilter) or not wanted.SelectClauses:
            return
        elements = wanted.WhereClause.Elements or []
        if len(wanted.SelectClauses) > limits.selected_fields or len(elements) > limits.filter_elements:
            self.code = Codes.BadTooManyOperations
            return
        codes = [self._fields.fault(clause) for clause in wanted.SelectClauses]
        where = [self._element(place, elements, limits) for place in range(len(elements))]
        self.select = [
            _NOTHING if code in _SELECTS_NOTHING else clause
            for clause, code in zip(wanted.SelectClauses, codes, strict=True)
        ]
        if all(codes):
            self.code = Codes.BadEventFilterInvalid
        else:
            self.code = next((code for code, _ in where if code), Codes.Good)
        if any(codes) or self.code:
            self.result = ua.EventFilterResult(SelectClauseResults=[status(code) for code in codes])
            self.result.WhereClauseResult.ElementResults = [
                ua.ContentFilterElementResult(
                    StatusCode=status(code), OperandStatusCodes=[status(operand) for operand in operands]
                )
                for code, operands in where
            ]

    def _element(self, place: int, elements: list[Any], limits: Limits) -> tuple[int, list[int]]:
        """Return the code of an element of the where-clause and those of its operands.

        An element may refer to later ones only, as the standard says, so no clause can go in circles.
        """
        element = elements[place]
        operands = element.FilterOperands or []
        if element.FilterOperator not in _WORKING:
            return Codes.BadFilterOperatorUnsupported, []
        if len(operands) < _WORKING[element.FilterOperator] or len(operands) > limits.filter_literals:
            return Codes.BadFilterOperandCountMismatch, []
        if sum(not isinstance(operand, ua.LiteralOperand) for operand in operands) > limits.filter_elements:
            return Codes.BadFilterOperandCountMismatch, []
        codes = [self._operand(operand, place, len(elements)) for operand in operands]
        if element.FilterOperator == ua.FilterOperator.OfType and not _names_a_type(operands[0]):
            codes[0] = codes[0] or Codes.BadFilterOperandInvalid
        return (Codes.BadFilterOperandInvalid if any(codes) else Codes.Good), codes

    def _operand(self, operand: Any, place: int, count: int) -> int:
        if not isinstance(operand, _OPERANDS):
            return Codes.BadFilterOperandInvalid
        if isinstance(operand, ua.ElementOperand) and not place < operand.Index < count:
            return Codes.BadFilterOperandInvalid
        if isinstance(operand, ua.SimpleAttributeOperand):
            return self._fields.fault(operand)
        return Codes.Good


def _names_a_type(operand: Any) -> bool:
    if not isinstance(operand, ua.LiteralOperand):
        return True  # worked out for each event
    return operand.Value is not None and isinstance(operand.Value.Value, ua.NodeId)


class _Fields:
    """The fields that event types declare, looked up once for all clauses of a filter."""

    def __init__(self, aspace: Any) -> None:
        self._aspace = aspace
        self._of: dict[ua.NodeId, list[Any]] = {}

    def fault(self, clause: ua.SimpleAttributeOperand) -> int:
        """Return why a clause selects nothing: no event type, no field of it or of its subtypes, no attribute."""
        names = [part.Name if part is not None else None for part in clause.BrowsePath or []]
        if not all(names):
            return Codes.BadBrowseNameInvalid
        if clause.AttributeId not in _ATTRIBUTES:
            return Codes.BadAttributeIdInvalid
        if clause.IndexRange and index_range(clause.IndexRange) is None:
            return Codes.BadIndexRangeInvalid
        event_type = _BASE if clause.TypeDefinitionId.is_null() else clause.TypeDefinitionId
        if event_type not in self._aspace:
            return Codes.BadNodeIdUnknown
        if not is_subtype(self._aspace, event_type, _BASE):
            return Codes.BadTypeDefinitionInvalid
        at = self._declared(event_type)
        for place, name in enumerate(names):
            found = [node for known, node in at if known == name]
            if not found:
                return Codes.BadBrowseNameInvalid
            at = [one for node in found for one in self._members(node)] if place < len(names) - 1 else []
        return Codes.Good

    def _declared(self, event_type: ua.NodeId) -> list[Any]:
        """Return name and node of what a type, the types above it and the types below it declare."""
        if event_type not in self._of:
            types = {*supertypes(self._aspace, event_type), *subtypes(self._aspace, event_type)}
            self._of[event_type] = [one for each in types for one in self._members(each)]
        return self._of[event_type]

    def _members(self, node: ua.NodeId) -> list[Any]:
        found = self._aspace.get(node)
        references = found.references if found is not None else []
        return [
            (one.BrowseName.Name, one.NodeId) for one in references if one.IsForward and one.ReferenceTypeId in _MEMBERS
        ]


def taken(wanted: ua.EventFilter, looked: FilterLooked) -> ua.EventFilter:
    """Return a filter that selects nothing where a clause makes no sense: its fields stay in their places."""
    return dataclasses.replace(wanted, SelectClauses=looked.select)

"""What a client may ask of a monitored item: event filters that know type hierarchies, and data filters that fit."""

import logging
import math
from collections.abc import Hashable
from typing import Any

from asyncua import ua
from asyncua.server.monitored_item_service import WhereClauseEvaluator
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes
from asyncua.ua.uaprotocol_auto import DataChangeFilter  # what is decoded: ua.DataChangeFilter is a child of it

from opcua_skill.stack.limits import Limits
from opcua_skill.stack.types import is_subtype

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


def _split(operands: list[Any]) -> tuple[frozenset[Any], list[Any]]:
    """Return the values of the literals of a list, and the operands that have to be worked out for each event."""
    literals = [one for one in operands if isinstance(one, ua.LiteralOperand)]
    values = frozenset(_key(one.Value.Value if one.Value is not None else None) for one in literals)
    return values, [one for one in operands if not isinstance(one, ua.LiteralOperand)]


def _key(value: Any) -> Any:
    """Return what stands for a value among others; what cannot be hashed is known by how it is written."""
    return value if isinstance(value, Hashable) else repr(value)


def event_filter_fault(wanted: Any, limits: Limits) -> int:
    """Return the code to refuse an event filter with, 0 for one that works.

    An element may refer to later ones only, as the standard says, so no clause can go in circles.
    """
    if not isinstance(wanted, ua.EventFilter) or not wanted.SelectClauses:
        return Codes.BadEventFilterInvalid
    elements = wanted.WhereClause.Elements or []
    if len(wanted.SelectClauses) > limits.selected_fields or len(elements) > limits.filter_elements:
        return Codes.BadTooManyOperations
    for clause in wanted.SelectClauses:
        known = isinstance(clause, ua.SimpleAttributeOperand) and clause.AttributeId in set(AttributeIds)
        if not known or any(part is None or not part.Name for part in clause.BrowsePath or []):
            return Codes.BadEventFilterInvalid
    for place, element in enumerate(elements):
        operands = element.FilterOperands or []
        if element.FilterOperator not in _WORKING:
            return Codes.BadFilterOperatorUnsupported
        if len(operands) < _WORKING[element.FilterOperator] or len(operands) > limits.filter_literals:
            return Codes.BadFilterOperandCountMismatch
        if sum(not isinstance(operand, ua.LiteralOperand) for operand in operands) > limits.filter_elements:
            return Codes.BadFilterOperandCountMismatch
        for operand in operands:
            if not isinstance(operand, _OPERANDS):
                return Codes.BadFilterOperandInvalid
            if isinstance(operand, ua.ElementOperand) and not place < operand.Index < len(elements):
                return Codes.BadFilterOperandInvalid
    return Codes.Good


def data_filter_fault(wanted: Any) -> int:
    """Return the code to refuse a data change filter with, 0 for one that works."""
    if wanted is None or (isinstance(wanted, ua.ExtensionObject) and not wanted.TypeId.Identifier):
        return Codes.Good
    if not isinstance(wanted, DataChangeFilter):
        return Codes.BadMonitoredItemFilterInvalid
    if not isinstance(wanted.Trigger, ua.DataChangeTrigger):
        return Codes.BadMonitoredItemFilterInvalid
    if wanted.DeadbandType == ua.DeadbandType.None_:
        return Codes.Good
    if wanted.DeadbandType != ua.DeadbandType.Absolute:
        return Codes.BadMonitoredItemFilterUnsupported
    good = math.isfinite(wanted.DeadbandValue) and wanted.DeadbandValue >= 0
    return Codes.Good if good else Codes.BadDeadbandFilterInvalid

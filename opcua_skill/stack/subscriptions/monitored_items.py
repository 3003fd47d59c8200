"""The monitored items of one subscription: checked filters, bounded queues, and values that are not copied for each."""

import asyncio
import functools
import logging
from collections.abc import Awaitable, Callable, Collection, Generator
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import ServiceError
from asyncua.server.address_space import AddressSpace
from asyncua.server.monitored_item_service import MonitoredItemData, MonitoredItemService, MonitoredItemValues
from asyncua.ua.attribute_ids import AttributeIds
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.address_space.values import status
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.services.index_ranges import index_range
from opcua_skill.stack.services.operations import attempted, attempted_at_once, refused
from opcua_skill.stack.services.reading import encoding_fault, narrowed
from opcua_skill.stack.subscriptions.data_filters import data_filter, moved
from opcua_skill.stack.subscriptions.filters import EventFilter, FilterLooked, taken
from opcua_skill.stack.subscriptions.queues import overflow

if TYPE_CHECKING:
    from opcua_skill.stack.subscriptions.subscriptions import Subscription

log = logging.getLogger(__name__)
ITEMS_BETWEEN_TURNS = 100
_NOT_THERE = frozenset({Codes.BadNodeIdUnknown, Codes.BadAttributeIdInvalid})


class _Done:
    """An awaitable that has nothing left to do: the address space awaits what the callback returns, or drops it."""

    def __await__(self) -> Generator[Any, Any, None]:
        return
        yield


_DONE = _Done()


class Items(MonitoredItemService):
    """The monitored items of one subscription."""

    isub: "Subscription"  # pyright: ignore[reportIncompatibleVariableOverride]

    def __init__(self, subscription: "Subscription", aspace: AddressSpace, limits: Limits) -> None:
        super().__init__(subscription, aspace)
        self._limits = limits
        self._handle_of: dict[int, int] = {}
        self._stamps: dict[int, ua.TimestampsToReturn] = {}
        self._wanted_stamps = ua.TimestampsToReturn.Both
        self._views: dict[int, Callable[[ua.DataValue], ua.DataValue]] = {}
        self._keeps_oldest: set[int] = set()
        self.sampling: set[int] = set()
        self.triggered: set[int] = set()
        self._links: dict[int, set[int]] = {}

    def __len__(self) -> int:
        return len(self._monitored_items)

    def disabled(self) -> int:
        """Return how many items are switched off."""
        return sum(1 for item in self._monitored_items.values() if item.mode == ua.MonitoringMode.Disabled)

    def watches(self, nodes: Collection[ua.NodeId]) -> bool:
        """Return whether one of these nodes is watched."""
        watched = (item.read_value_id for item in self._monitored_items.values())
        return any(one is not None and one.NodeId in nodes for one in watched)

    def __bool__(self) -> bool:
        return True

    async def create_monitored_items(self, params: Any) -> list[ua.MonitoredItemCreateResult]:
        """Add items; each has a result of its own."""
        results: list[ua.MonitoredItemCreateResult] = []
        not_made = functools.partial(refused, ua.MonitoredItemCreateResult)
        self._wanted_stamps = params.TimestampsToReturn
        for place, item in enumerate(params.ItemsToCreate):
            results.append(await attempted(lambda item=item: self._create(item), not_made, "CreateMonitoredItems"))
            if place % ITEMS_BETWEEN_TURNS == ITEMS_BETWEEN_TURNS - 1:
                await asyncio.sleep(0)
        return results

    async def _create(self, item: Any) -> ua.MonitoredItemCreateResult:
        if code := self._fault(item):
            return refused(ua.MonitoredItemCreateResult, code)
        if item.ItemToMonitor.AttributeId == AttributeIds.EventNotifier:
            result = self._create_events_monitored_item(item)
        else:
            result = await self._create_data_change_monitored_item(item)
        if result.StatusCode.is_good():
            self._keep_oldest(result.MonitoredItemId, item.RequestedParameters)
        return result

    def _keep_oldest(self, mid: int, wanted: ua.MonitoringParameters) -> None:
        (self._keeps_oldest.discard if wanted.DiscardOldest else self._keeps_oldest.add)(mid)

    def _fault(self, item: Any) -> int:
        """Return why a node cannot be monitored so, whatever the filter; 0 if it can."""
        wanted = item.ItemToMonitor
        if not isinstance(item.MonitoringMode, ua.MonitoringMode):
            return Codes.BadMonitoringModeInvalid
        if wanted.IndexRange and index_range(wanted.IndexRange) is None:
            return Codes.BadIndexRangeInvalid
        if wanted.AttributeId == AttributeIds.Value and not self.isub.may_read(wanted.NodeId):
            return Codes.BadUserAccessDenied
        now = self.aspace.read_attribute_value(wanted.NodeId, wanted.AttributeId)
        if now.StatusCode is not None and now.StatusCode.value in _NOT_THERE:
            return now.StatusCode.value
        return encoding_fault(now, wanted)

    def _create_events_monitored_item(self, params: ua.MonitoredItemCreateRequest) -> ua.MonitoredItemCreateResult:
        wanted = params.RequestedParameters
        looked = FilterLooked(wanted.Filter, self._limits, self.aspace)
        if looked.code:
            result = refused(ua.MonitoredItemCreateResult, looked.code)
        else:
            wanted.Filter = taken(wanted.Filter, looked)
            wanted.QueueSize = self._queue_for_events(wanted.QueueSize)
            result = super()._create_events_monitored_item(params)
            result.RevisedSamplingInterval = 0.0  # pyright: ignore[reportAttributeAccessIssue] - events are not sampled
        result.FilterResult = looked.result
        item = self._monitored_items.get(result.MonitoredItemId) if result.StatusCode.is_good() else None
        if item is not None:
            item.where_clause_evaluator = EventFilter(self.logger, self.aspace, item.filter.WhereClause)
        return result

    def _queue_for_events(self, wanted: int) -> int:
        """Return the queue of an item for events: a size of 1 asks for the least this server holds to be enough.

        Clients ask for 1 unless told otherwise; one order brings several events within a publishing interval, and all
        but the last would be lost. OPC UA Part 4, 7.21 (MonitoringParameters, queueSize).
        """
        return max(wanted, self._limits.queue_for_events) if wanted else 0

    async def _create_data_change_monitored_item(self, params: Any) -> ua.MonitoredItemCreateResult:
        found = data_filter(params.RequestedParameters.Filter, self.aspace, params.ItemToMonitor)
        if isinstance(found, int):
            return refused(ua.MonitoredItemCreateResult, found)
        params.RequestedParameters.Filter = found
        if not params.RequestedParameters.QueueSize:
            params.RequestedParameters.QueueSize = 1
        result = await super()._create_data_change_monitored_item(params)
        item = self._monitored_items.get(result.MonitoredItemId)
        if item is not None and item.callback_handle is not None:
            self._handle_of[result.MonitoredItemId] = item.callback_handle
            self._stamps[result.MonitoredItemId] = self._wanted_stamps
        return result

    def _commit_monitored_item(self, result: ua.MonitoredItemCreateResult, mdata: MonitoredItemData) -> None:
        super()._commit_monitored_item(result, mdata)
        wanted = mdata.read_value_id
        if wanted is not None and wanted.IndexRange and mdata.where_clause_evaluator is None:
            self._views[result.MonitoredItemId] = functools.partial(narrowed, wanted=wanted)
        if mdata.mode == ua.MonitoringMode.Sampling:
            self.sampling.add(result.MonitoredItemId)

    async def _set_monitoring_mode(self, mode: ua.MonitoringMode, mid: int) -> ua.StatusCode:
        done = await super()._set_monitoring_mode(mode, mid)
        if done.is_good():
            (self.sampling.add if mode == ua.MonitoringMode.Sampling else self.sampling.discard)(mid)
            if mode == ua.MonitoringMode.Disabled:
                self._monitored_items[mid].mvalue = MonitoredItemValues()  # what it has when it is enabled is news
                self.isub.forget_item(mid)
        return done

    def modify_monitored_items(self, params: Any) -> list[ua.MonitoredItemModifyResult]:
        """Change items; each has a result of its own."""
        self._wanted_stamps = params.TimestampsToReturn
        unchanged = functools.partial(refused, ua.MonitoredItemModifyResult)
        return [
            attempted_at_once(lambda item=item: self._modify_monitored_item(item), unchanged, "ModifyMonitoredItems")
            for item in params.ItemsToModify
        ]

    def discards_oldest(self, mid: int) -> bool:
        """Return whether an item's full queue drops its oldest entry rather than its newest."""
        return mid not in self._keeps_oldest

    def overflow(self, mid: int) -> ua.EventFieldList:
        """Return the event that tells an item of events it has lost, in the fields it selects."""
        return overflow(self._monitored_items[mid])

    def stamps(self, mid: int) -> ua.TimestampsToReturn:
        """Return which timestamps an item's values are told with."""
        return self._stamps.get(mid, ua.TimestampsToReturn.Both)

    def handles(self) -> tuple[list[int], list[int]]:
        """Return the ids of the items, and what the client calls them."""
        return list(self._monitored_items), [int(item.client_handle or 0) for item in self._monitored_items.values()]

    def set_triggering(self, mid: int, add: list[int], remove: list[int]) -> ua.SetTriggeringResult:
        """Change which items report when another one has something to tell; links to remove go first."""
        if mid not in self._monitored_items:
            raise ServiceError(Codes.BadMonitoredItemIdInvalid)
        links, result = self._links.setdefault(mid, set()), ua.SetTriggeringResult()
        for one in remove:
            result.RemoveResults.append(status(Codes.Good if one in links else Codes.BadMonitoredItemIdInvalid))
            links.discard(one)
        for one in add:
            known = one in self._monitored_items
            result.AddResults.append(status(Codes.Good if known else Codes.BadMonitoredItemIdInvalid))
            links.update({one} if known else ())
        if not links:
            del self._links[mid]
        return result

    def trigger(self, mid: int) -> None:
        """An item has something to tell: those linked to it that only sample report with the next message."""
        if mid in self._links:
            self.triggered |= self._links[mid] & self.sampling

    def tell_again(self) -> None:
        """Queue the value each item that reports has now, for a session that takes over or asks for it."""
        for mid, item in self._monitored_items.items():
            value = item.mvalue.current_dvalue
            if value is not None and item.mode == ua.MonitoringMode.Reporting:
                self.isub.queue_value(mid, item, value)

    def hears_events(self, mid: int) -> bool:
        """Return whether there is such an item, and it is one of events."""
        item = self._monitored_items.get(mid)
        return item is not None and item.where_clause_evaluator is not None

    def tell_event(self, event: Any, mid: int | None) -> None:
        """Queue an event for one item of events, or for all, whatever they filter for."""
        for one in [mid] if mid is not None else list(self._monitored_items):
            item = self._monitored_items[one]
            if self.hears_events(one) and item.mode != ua.MonitoringMode.Disabled:
                self.isub.queue_event(one, item, event.to_event_fields(item.filter.SelectClauses))

    def _modify_monitored_item(self, params: ua.MonitoredItemModifyRequest) -> ua.MonitoredItemModifyResult:
        result, wanted = ua.MonitoredItemModifyResult(), params.RequestedParameters
        item = self._monitored_items.get(params.MonitoredItemId)
        if item is None:
            result.StatusCode = status(Codes.BadMonitoredItemIdInvalid)
            return result
        for_events = item.where_clause_evaluator is not None
        if code := self._refilter(item, wanted.Filter, result) if for_events else self._redampen(item, wanted.Filter):
            result.StatusCode = status(code)
            return result
        asked_for = self._queue_for_events(wanted.QueueSize) if for_events else wanted.QueueSize or 1
        item.queue_size = self._revise_queue_size(asked_for)
        item.client_handle = wanted.ClientHandle
        self._keep_oldest(params.MonitoredItemId, wanted)
        if not for_events:
            self._stamps[params.MonitoredItemId] = self._wanted_stamps
        result.RevisedQueueSize = item.queue_size  # pyright: ignore[reportAttributeAccessIssue]
        result.RevisedSamplingInterval = 0.0 if for_events else self.isub.data.RevisedPublishingInterval  # pyright: ignore[reportAttributeAccessIssue]
        return result

    def _refilter(self, item: MonitoredItemData, wanted: Any, result: ua.MonitoredItemModifyResult) -> int:
        """Give an item of events another filter; none leaves the one it has."""
        if wanted is None or (isinstance(wanted, ua.ExtensionObject) and not wanted.TypeId.Identifier):
            return Codes.Good
        looked = FilterLooked(wanted, self._limits, self.aspace)
        result.FilterResult = looked.result
        if not looked.code and isinstance(wanted, ua.EventFilter):
            item.filter = taken(wanted, looked)
            item.where_clause_evaluator = EventFilter(self.logger, self.aspace, item.filter.WhereClause)
        return looked.code

    def _redampen(self, item: MonitoredItemData, wanted: Any) -> int:
        """Give an item of values another filter; none leaves the one it has."""
        assert item.read_value_id is not None
        found = data_filter(wanted, self.aspace, item.read_value_id)
        if isinstance(found, int):
            return found
        item.filter = found or item.filter
        return Codes.Good

    def _delete_monitored_items(self, mid: int) -> ua.StatusCode:
        item = self._monitored_items.pop(mid, None)
        if item is None:
            return status(Codes.BadMonitoredItemIdInvalid)
        self._stamps.pop(mid, None)
        self._views.pop(mid, None)
        self._keeps_oldest.discard(mid)
        self.sampling.discard(mid)
        self._links.pop(mid, None)
        for links in self._links.values():
            links.discard(mid)
        handle = self._handle_of.pop(mid, None)
        if handle is not None:
            self._monitored_datachange.pop(handle, None)
            self._forget(handle)
        elif item.read_value_id is not None and item.read_value_id.NodeId in self._monitored_events:
            listening = self._monitored_events[item.read_value_id.NodeId]
            listening.remove(mid)
            if not listening:
                del self._monitored_events[item.read_value_id.NodeId]
        self.isub.forget_item(mid)
        return status()

    def _forget(self, handle: int) -> None:
        """Stop hearing of a value; its node may be gone already."""
        place = self.aspace._handle_to_attribute_map.pop(handle, None)
        node = self.aspace.get(place[0]) if place is not None else None
        if place is not None and node is not None and place[1] in node.attributes:
            node.attributes[place[1]].datachange_callbacks.pop(handle, None)

    def datachange_callback(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, handle: int, value: ua.DataValue | None, error: ua.StatusCode | None = None
    ) -> Awaitable[None]:
        """Queue a value that has changed, or that its node is gone.

        The value is shared by all who monitor it: a DataValue is replaced by a write, never changed by one.
        """
        mid = self._monitored_datachange.get(handle)
        item = self._monitored_items.get(mid) if mid is not None else None
        if mid is None or item is None or item.mode == ua.MonitoringMode.Disabled:
            return _DONE
        if error is not None or value is None:
            value = ua.DataValue(StatusCode=error or status(Codes.BadNodeIdUnknown))
        if (view := self._views.get(mid)) is not None:
            value = view(value)
        item.mvalue.current_dvalue = value
        if self._passes(item):
            item.mvalue.old_dvalue = value
            self.isub.queue_value(mid, item, value)
        return _DONE

    def _passes(self, item: MonitoredItemData) -> bool:
        """Return whether a value differs enough from the one told last: many small steps come to a large one."""
        values, wanted = item.mvalue, item.filter
        if wanted is None:
            return self._is_data_changed(values, ua.DataChangeTrigger.StatusValue)
        if not self._is_data_changed(values, wanted.Trigger):
            return False
        old, new = values.old_dvalue, values.current_dvalue
        if wanted.DeadbandType == ua.DeadbandType.None_ or old is None or new is None:
            return True
        return old.StatusCode != new.StatusCode or moved(old.Value, new.Value, wanted.DeadbandValue)

    async def _trigger_event(self, event: Any, mid: int) -> None:
        item = self._monitored_items.get(mid)
        if item is None or item.where_clause_evaluator is None or item.mode == ua.MonitoringMode.Disabled:
            return
        about = getattr(event, "audited_user", None)
        if about is not None and not self.isub.may_hear_of(about):
            return
        if not item.where_clause_evaluator.eval(event):
            return
        fields = event.to_event_fields(item.filter.SelectClauses)
        self.isub.queue_event(mid, item, self.isub.in_its_language(fields))
        await self.isub._trigger_publish()

"""How asyncua by itself keeps subscriptions, items and events.

A test that fails here says which of ours may go; `replacements.py` names it.
"""

import logging
from types import SimpleNamespace
from typing import Any

import pytest
from asyncua import ua
from asyncua.server.internal_session import InternalSession
from asyncua.server.internal_subscription import InternalSubscription
from asyncua.server.monitored_item_service import WhereClauseEvaluator

from opcua_skill.stack.limits import Limits
from tests.opcua_skill.stack.stock_server import Stock, mended, still_raises

pytestmark = pytest.mark.asyncio(loop_scope="package")
Codes, Ids, VALUE = ua.StatusCodes, ua.ObjectIds, ua.AttributeIds.Value
HOUR = 3_600_000.0


async def subscribed(stock: Stock, session: InternalSession | None = None, interval: float = HOUR) -> int:
    params = ua.CreateSubscriptionParameters(RequestedPublishingInterval=interval, PublishingEnabled=True)

    async def callback(*given) -> None:
        pass

    session = session or stock.session()
    made = await session.create_subscription(params, callback, request_callback=lambda number: None)
    return int(made.SubscriptionId)


def subscription(stock: Stock, number: int) -> InternalSubscription:
    return stock.iserver.subscription_service.subscriptions[number]


async def item(
    stock: Stock, number: int, name: str, mode=ua.MonitoringMode.Reporting, part: str | None = None, **wanted: Any
) -> ua.MonitoredItemCreateResult:
    node, attribute = (ua.NodeId(Ids.Server), 12) if name == "Server" else (stock.node(name), VALUE)
    request = ua.MonitoredItemCreateRequest(MonitoringMode=mode)
    request.ItemToMonitor = ua.ReadValueId(NodeId=node, AttributeId=attribute, IndexRange=part)
    request.RequestedParameters = ua.MonitoringParameters(**wanted)
    params = ua.CreateMonitoredItemsParameters(SubscriptionId=number, ItemsToCreate=[request])
    (made,) = await stock.iserver.subscription_service.create_monitored_items(params)
    return made


async def test_a_subscription_may_outlive_its_session(stock: Stock):
    session = stock.session()
    number = await subscribed(stock, session)
    await session.close_session(False)
    left = stock.iserver.subscription_service.subscriptions
    assert number in left, mended("subscriptions end with their session", "sessions.py: Session.close_session")
    await stock.session().delete_subscriptions([number])


async def test_a_subscription_may_be_as_fast_and_as_many_as_asked(stock: Stock):
    session = stock.session()
    numbers = [await subscribed(stock, session) for _ in range(Limits().subscriptions_per_session + 1)]
    assert len(numbers) > Limits().subscriptions_per_session, mended("there are limits", "subscriptions.py: admit")
    fast = await subscribed(stock, session, interval=1.0)
    told = subscription(stock, fast).data.RevisedPublishingInterval
    assert told == 1.0, mended("intervals have bounds", "subscriptions.py: Subscriptions.revise")
    await session.delete_subscriptions([*numbers, fast])


async def test_a_subscription_cannot_be_modified(stock: Stock):
    number = await subscribed(stock)
    params = ua.ModifySubscriptionParameters(SubscriptionId=number, RequestedPublishingInterval=100.0)
    told = stock.iserver.subscription_service.modify_subscription(params)
    assert told.RevisedPublishingInterval == HOUR, mended(
        "subscriptions are modified", "subscriptions.py: modify_subscription and _subscription_loop"
    )
    await stock.session().delete_subscriptions([number])


async def test_a_subscription_has_no_owner(stock: Stock):
    number, other = await subscribed(stock), stock.session()
    made = await item(stock, number, "Speed")
    ids, service = [made.MonitoredItemId], stock.iserver.subscription_service

    create = ua.CreateMonitoredItemsParameters(SubscriptionId=number)
    create.ItemsToCreate = [ua.MonitoredItemCreateRequest(ItemToMonitor=ua.ReadValueId(NodeId=stock.node("Word")))]
    create.ItemsToCreate[0].ItemToMonitor.AttributeId = VALUE
    modify = ua.ModifyMonitoredItemsParameters(SubscriptionId=number)
    modify.ItemsToModify = [ua.MonitoredItemModifyRequest(MonitoredItemId=ids[0])]
    mode = ua.SetMonitoringModeParameters(SubscriptionId=number, MonitoredItemIds=ids)
    publishing = ua.SetPublishingModeParameters(PublishingEnabled=False, SubscriptionIds=[number])
    transfer = ua.TransferSubscriptionsParameters(SubscriptionIds=[number])
    ack = ua.SubscriptionAcknowledgement(SubscriptionId=number, SequenceNumber=1)
    codes = {
        "create": (await other.create_monitored_items(create))[0].StatusCode,
        "modify items": (await other.modify_monitored_items(modify))[0].StatusCode,
        "mode": (await other.set_monitoring_mode(mode))[0],
        "publishing": (await other.set_publishing_mode(publishing))[0],
        "acknowledge": other.publish([ack])[1][0],
        "transfer": (await service.transfer_subscriptions(transfer, other.session_id, None))[0].StatusCode,
        "delete items": (await other.delete_monitored_items(ua.DeleteMonitoredItemsParameters(number, ids)))[0],
        "delete": (await other.delete_subscriptions([number]))[0],
    }
    told = {what: code.name for what, code in codes.items()}
    assert told == dict.fromkeys(told, "Good"), mended("subscriptions have an owner", "subscribing.py")
    assert other.republish(ua.RepublishParameters(number, 1)).SequenceNumber == 0, mended(
        "a lost message has its code", "subscribing.py: republish"
    )


async def test_a_value_is_encoded_for_each_subscriber(stock: Stock):
    number = await subscribed(stock)
    await item(stock, number, "Speed")
    result = subscription(stock, number)._pop_publish_result()
    (told,) = result.NotificationMessage.NotificationData
    assert isinstance(told, ua.DataChangeNotification), mended("encodings are shared", "subscriptions.py: Encodings")
    await stock.session().delete_subscriptions([number])


async def test_a_message_may_have_any_number_of_notifications(stock: Stock):
    wanted = ua.CreateSubscriptionParameters(RequestedPublishingInterval=1e6, MaxNotificationsPerPublish=1)
    number = (await stock.session().create_subscription(wanted, no_callback, no_callback)).SubscriptionId
    for name in ("Speed", "Word"):
        await item(stock, number, name)
    (told,) = subscription(stock, number)._pop_publish_result().NotificationMessage.NotificationData
    assert len(told.MonitoredItems) == 2, mended("messages have bounds", "subscriptions.py: Subscription._hold_back")
    await stock.session().delete_subscriptions([number])


async def test_a_subscription_expires_in_silence(stock: Stock):
    told: list[Any] = []

    async def tell(result: Any, *_: Any) -> None:
        told.append(result)

    wanted = ua.CreateSubscriptionParameters(RequestedPublishingInterval=1e6)
    number = (await stock.session().create_subscription(wanted, tell, no_callback)).SubscriptionId
    subscription(stock, number)._publish_cycles_count = 10**6
    await subscription(stock, number).publish_results()
    assert number not in stock.iserver.subscription_service.subscriptions
    assert not told, mended("the end of a subscription is told", "subscriptions.py: Subscription._expire")


def no_callback(*_: Any) -> None:
    return None


async def test_an_item_ignores_range_and_filter(stock: Stock):
    number = await subscribed(stock)
    made = await item(stock, number, "Row", part="1")
    (queued,) = subscription(stock, number)._triggered_datachanges[made.MonitoredItemId]
    assert queued.Value.Value.Value == [1.0, 2.0, 3.0], mended("a part is monitored", "items.py: _views")
    element = ua.ContentFilterElement(FilterOperator=ua.FilterOperator.RelatedTo)
    odd = ua.EventFilter(WhereClause=ua.ContentFilter(Elements=[element]))
    made = await item(stock, number, "Server", Filter=odd)
    assert made.StatusCode.is_good(), mended("event filters are looked at", "filters.py: FilterLooked")
    with still_raises(AttributeError, "a filter must suit its item", "data_filters.py: data_filter"):
        await item(stock, number, "Speed", Filter=odd)
        await stock.server.get_node(stock.node("Speed")).write_value(2.5)
    made = await item(stock, number, "Word", QueueSize=0)
    assert made.RevisedQueueSize > 1, mended("no queue asked for is a queue of one", "items.py")
    await stock.session().delete_subscriptions([number])


async def test_a_full_queue_loses_in_silence(stock: Stock):
    number = await subscribed(stock)
    made = await item(stock, number, "Speed", QueueSize=2, DiscardOldest=False)
    for value in (2.25, 2.5, 2.75):
        await stock.server.get_node(stock.node("Speed")).write_value(value)
    queued = subscription(stock, number)._triggered_datachanges[made.MonitoredItemId]
    told = [(one.Value.Value.Value, one.Value.StatusCode.value) for one in queued]
    assert told == [(2.5, 0), (2.75, 0)], mended("what is lost is told", "subscriptions.py: queue_value")
    heard = await item(stock, number, "Server", Filter=ua.EventFilter(), QueueSize=1)
    assert heard.RevisedQueueSize == 1, mended("events have a least queue", "items.py: Items._queue_for_events")
    item_ids = ua.DeleteMonitoredItemsParameters(number, [heard.MonitoredItemId])
    await stock.session().delete_monitored_items(item_ids)
    await stock.session().delete_subscriptions([number])


async def test_an_item_that_samples_reports(stock: Stock):
    number = await subscribed(stock)
    subscription(stock, number)._pop_publish_result()
    made = await item(stock, number, "Speed", mode=ua.MonitoringMode.Sampling)
    assert made.MonitoredItemId in subscription(stock, number)._triggered_datachanges
    assert subscription(stock, number).has_published_results(), mended(
        "what samples is silent", "subscriptions.py: Subscription._without_sampling"
    )
    await stock.session().delete_subscriptions([number])


async def test_an_item_is_modified_beyond_bounds_or_with_a_fault(stock: Stock):
    number = await subscribed(stock)
    made = await item(stock, number, "Speed")
    known, unknown = (
        ua.MonitoredItemModifyRequest(MonitoredItemId=made.MonitoredItemId),
        ua.MonitoredItemModifyRequest(),
    )
    known.RequestedParameters.QueueSize = 5_000_000
    params = ua.ModifyMonitoredItemsParameters(SubscriptionId=number, ItemsToModify=[known])
    (told,) = await stock.session().modify_monitored_items(params)
    assert told.RevisedQueueSize == 5_000_000, mended("queues have bounds", "items.py: Items._modify_monitored_item")
    params.ItemsToModify = [unknown]
    with still_raises(TypeError, "an unknown item has its code", "items.py: Items._modify_monitored_item"):
        await stock.session().modify_monitored_items(params)
    await stock.session().delete_subscriptions([number])


async def test_what_a_deleted_item_had_queued_is_still_sent(stock: Stock):
    number = await subscribed(stock)
    made = await item(stock, number, "Speed")
    await stock.session().delete_monitored_items(ua.DeleteMonitoredItemsParameters(number, [made.MonitoredItemId]))
    queued = subscription(stock, number)._triggered_datachanges
    assert made.MonitoredItemId in queued, mended("what was queued goes", "items.py: Items._delete_monitored_items")
    await stock.session().delete_subscriptions([number])


async def test_a_node_that_is_gone_is_told_to_the_whole_subscription(stock: Stock):
    number = await subscribed(stock)
    await item(stock, number, "Speed")
    items = subscription(stock, number).monitored_item_srv
    (handle,) = items._monitored_datachange
    await items.datachange_callback(handle, ua.DataValue(), ua.StatusCode(Codes.BadNodeIdUnknown))
    told = subscription(stock, number)._triggered_statuschanges
    assert told, mended("only the item is told", "items.py: Items.datachange_callback")
    await stock.session().delete_subscriptions([number])


async def test_a_deadband_on_text_is_a_fault(stock: Stock):
    number = await subscribed(stock)
    wanted = ua.DataChangeFilter(DeadbandType=ua.DeadbandType.Absolute, DeadbandValue=1.0)
    items = subscription(stock, number).monitored_item_srv
    values = SimpleNamespace(
        get_old_datavalue=lambda: ua.DataValue("a"), get_current_datavalue=lambda: ua.DataValue("b")
    )
    with still_raises(TypeError, "a deadband suits its value", "data_filters.py: moved"):
        items._is_deadband_exceeded(values, wanted)
    await stock.session().delete_subscriptions([number])


async def raised(stock: Stock) -> Any:
    generator = await stock.server.get_event_generator(emitting_node=stock.server.get_node(stock.node("Cell")))
    await generator.trigger(message="told")
    return generator.event


async def test_an_event_does_not_rise_to_the_server(stock: Stock):
    number = await subscribed(stock)
    made = await item(stock, number, "Server", Filter=ua.EventFilter())
    assert made.StatusCode.is_good()
    await raised(stock)
    told = subscription(stock, number)._triggered_events
    assert not told, mended("events rise to the Server", "events.py: deliver")
    await stock.session().delete_subscriptions([number])


async def test_an_item_that_is_off_hears_events(stock: Stock):
    number = await subscribed(stock)
    made = await item(stock, number, "Server", mode=ua.MonitoringMode.Disabled, Filter=ua.EventFilter())
    event = await raised(stock)
    event.emitting_node = ua.NodeId(Ids.Server)
    await stock.iserver.subscription_service.trigger_event(event)
    told = subscription(stock, number)._triggered_events
    assert made.MonitoredItemId in told, mended("what is off is silent", "items.py: Items._trigger_event")
    await stock.session().delete_subscriptions([number])


def where(operator: ua.FilterOperator, *operands: Any) -> ua.ContentFilter:
    return ua.ContentFilter(Elements=[ua.ContentFilterElement(FilterOperator=operator, FilterOperands=list(operands))])


async def test_of_type_is_for_the_exact_type(stock: Stock):
    base = ua.LiteralOperand(Value=ua.Variant(ua.NodeId(Ids.BaseEventType)))
    clause = WhereClauseEvaluator(
        logging.getLogger("test"), stock.iserver.aspace, where(ua.FilterOperator.OfType, base)
    )
    event = SimpleNamespace(EventType=ua.NodeId(Ids.ProgramTransitionEventType))
    assert clause.eval(event) is False, mended("OfType knows subtypes", "filters.py: EventFilter._eval_el")


async def test_a_filter_that_does_not_fit_an_event_is_a_traceback(stock: Stock, caplog):
    field = ua.SimpleAttributeOperand(BrowsePath=[ua.QualifiedName("Nothing")])
    operands = (field, ua.LiteralOperand(Value=ua.Variant(1)))
    filter_of = where(ua.FilterOperator.GreaterThan, *operands)
    WhereClauseEvaluator(logging.getLogger("test"), stock.iserver.aspace, filter_of).eval(SimpleNamespace())
    assert any(record.exc_info for record in caplog.records), mended("a filter says no", "filters.py: EventFilter.eval")

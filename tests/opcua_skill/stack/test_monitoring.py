"""Monitored items and subscriptions as foreign clients change them: modes, timestamps, transfers, lost messages."""

import asyncio

import pytest
from asyncua import Client, ua
from asyncua.common.subscription import Subscription

from tests.opcua_skill.stack.small_server import Bench, until

pytestmark = pytest.mark.asyncio(loop_scope="package")


class Told:
    """What a subscription brings, as it comes: value, whether it has a source timestamp, whether a server timestamp."""

    def __init__(self) -> None:
        self.values: list[tuple] = []

    def datachange_notification(self, node, content, data) -> None:
        stamps = data.monitored_item.Value
        self.values.append((content, stamps.SourceTimestamp is not None, stamps.ServerTimestamp is not None))

    @property
    def last(self):
        return self.values[-1][0] if self.values else None


def speed(bench: Bench) -> ua.NodeId:
    return ua.NodeId("Cell/Speed", bench.index)


async def watching(bench: Bench, client: Client, queue: int = 1) -> tuple[Subscription, int, Told]:
    told = Told()
    subscription = await client.create_subscription(50, told)
    handle = await subscription.subscribe_data_change(client.get_node(speed(bench)), queuesize=queue)
    await until(lambda: bool(told.values))
    return subscription, handle, told


async def set_mode(client: Client, subscription: Subscription, handle: int, mode: ua.MonitoringMode) -> str:
    params = ua.SetMonitoringModeParameters(
        SubscriptionId=subscription.subscription_id, MonitoringMode=mode, MonitoredItemIds=[handle]
    )
    (code,) = await client.uaclient.set_monitoring_mode(params)
    return code.name


async def test_an_item_that_samples_keeps_its_values_until_it_reports(bench: Bench):
    node = bench.server.get_node(speed(bench))
    async with bench.client() as client:
        subscription, handle, told = await watching(bench, client, queue=10)
        marker = Told()
        other = await client.create_subscription(50, marker)
        await other.subscribe_data_change(client.get_node(node.nodeid))
        assert await set_mode(client, subscription, handle, ua.MonitoringMode.Sampling) == "Good"
        before = len(told.values)
        for number in (11.0, 12.0, 13.0):
            await node.write_value(number)
        await until(lambda: marker.last == 13.0)
        await asyncio.sleep(0.15)  # three intervals in which nothing may come: only time can show that
        assert len(told.values) == before
        await set_mode(client, subscription, handle, ua.MonitoringMode.Reporting)
        await until(lambda: [one[0] for one in told.values[before:]] == [11.0, 12.0, 13.0])
        assert await set_mode(client, subscription, handle + 1000, ua.MonitoringMode.Disabled) == (
            "BadMonitoredItemIdInvalid"
        )


async def test_publishing_is_switched_per_subscription_and_each_has_its_own_result(bench: Bench):
    node = bench.server.get_node(speed(bench))
    async with bench.client() as client, bench.client("observer") as stranger:
        subscription, _, told = await watching(bench, client)
        number = subscription.subscription_id

        async def publishing(who: Client, on: bool, *ids: int) -> list[str]:
            params = ua.SetPublishingModeParameters(PublishingEnabled=on, SubscriptionIds=list(ids))
            return [code.name for code in await who.uaclient.set_publishing_mode(params)]

        assert await publishing(stranger, False, number) == ["BadSubscriptionIdInvalid"]
        assert await publishing(client, False, number, 9_999) == ["Good", "BadSubscriptionIdInvalid"]
        await node.write_value(21.0)
        await asyncio.sleep(0.15)  # three intervals in which nothing may come
        assert told.last != 21.0
        await publishing(client, True, number)
        await until(lambda: told.last == 21.0)


async def test_an_item_is_modified_and_tells_the_timestamps_asked_for(bench: Bench):
    node = bench.server.get_node(speed(bench))
    async with bench.client() as client:
        subscription, handle, told = await watching(bench, client)
        request = ua.MonitoredItemModifyRequest(MonitoredItemId=handle)
        request.RequestedParameters.ClientHandle = next(iter(subscription._monitored_items.values())).client_handle
        request.RequestedParameters.QueueSize = 5_000
        unknown = ua.MonitoredItemModifyRequest(MonitoredItemId=handle + 1000)
        params = ua.ModifyMonitoredItemsParameters(SubscriptionId=subscription.subscription_id)
        params.TimestampsToReturn, params.ItemsToModify = ua.TimestampsToReturn.Neither, [request, unknown]
        results = await client.uaclient.modify_monitored_items(params)
        assert [result.StatusCode.name for result in results] == ["Good", "BadMonitoredItemIdInvalid"]
        assert results[0].RevisedQueueSize == 100
        await node.write_value(31.0)
        await until(lambda: (31.0, False, False) in told.values)
        params.TimestampsToReturn = ua.TimestampsToReturn.Server
        await client.uaclient.modify_monitored_items(params)
        await node.write_value(32.0)
        await until(lambda: (32.0, False, True) in told.values)
        params.TimestampsToReturn = ua.TimestampsToReturn.Invalid
        with pytest.raises(ua.uaerrors.BadTimestampsToReturnInvalid):
            await client.uaclient.modify_monitored_items(params)


async def test_a_subscription_moves_to_another_session_of_the_same_user_and_tells_its_values_again(bench: Bench):
    async with bench.client("engineer") as first, bench.client("engineer") as second:
        subscription, _, told = await watching(bench, first)
        number = subscription.subscription_id
        moved: list[ua.PublishResult] = []
        here = (await second.create_subscription(50, Told())).subscription_id
        second.uaclient._subscription_callbacks[number] = moved.append
        params = ua.TransferSubscriptionsParameters(SubscriptionIds=[number, 9_999], SendInitialValues=True)
        results = await second.uaclient.transfer_subscriptions(params)
        assert [result.StatusCode.name for result in results] == ["Good", "BadSubscriptionIdInvalid"]
        await until(lambda: any(one.NotificationMessage.NotificationData for one in moved))
        (change,) = next(one.NotificationMessage.NotificationData for one in moved if one.NotificationMessage)
        assert change.MonitoredItems[0].Value.Value.Value == told.last
        served = bench.server.iserver.subscription_service.subscriptions
        assert served[number].session_id == served[here].session_id
        with pytest.raises(ua.uaerrors.BadSubscriptionIdInvalid):
            await first.uaclient.session.republish(number, 1)
        with pytest.raises(ua.uaerrors.BadMessageNotAvailable):
            await second.uaclient.session.republish(number, 4_000_000)

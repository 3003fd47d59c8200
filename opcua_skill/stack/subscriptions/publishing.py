"""Publish requests of one connection: kept until there is something to say, and answered when there is no more."""

import time
from typing import TYPE_CHECKING, Any

from asyncua import ua
from asyncua.common.utils import Buffer
from asyncua.server.uaprocessor import PublishRequestData, UaProcessor
from asyncua.ua.object_ids import ObjectIds as Ids
from asyncua.ua.status_codes import StatusCodes as Codes

from opcua_skill.stack.address_space.values import status
from opcua_skill.stack.transport.decoding import decode

if TYPE_CHECKING:
    from opcua_skill.stack.sessions.sessions import Session

PUBLISH = Ids.PublishRequest_Encoding_DefaultBinary


class Publishing(UaProcessor):
    """The Publish service of one connection, and what becomes of requests that wait."""

    session: "Session | None"  # pyright: ignore[reportIncompatibleVariableOverride]

    async def publish(self, session: "Session", header: Any, seqhdr: Any, body: Buffer) -> None:
        """Keep a publish request until one of the session's subscriptions has something to say."""
        session.counts.requests[PUBLISH] += 1
        params = decode(ua.PublishParameters, body)
        subscriptions, results = session.publish(params.SubscriptionAcknowledgements)
        request = PublishRequestData(requesthdr=header, seqhdr=seqhdr, results=results)
        while not session.notices and self._publish_results_subs:
            known = session.iserver.subscription_service.subscriptions
            waiting = max(self._publish_results_subs, key=lambda one: known[one].priority if one in known else 0)
            del self._publish_results_subs[waiting]
            subscription = known.get(waiting)
            if subscription is None or subscription.session_id != session.session_id:
                continue
            if await subscription.publish_results(request):
                return
        if len(self._publish_requests) >= self.publish_request_limit(subscriptions):
            self._evict_publish_request()
        self._publish_requests.append(request)
        self.tell_notices()

    def tell_notices(self) -> None:
        """Tell the client which subscriptions are over, as far as it has asked; with the last one nothing waits on."""
        session = self.session
        if session is None:
            return
        while session.notices and (request := self._next_publish_request()) is not None:
            response = ua.PublishResponse()
            response.Parameters = session.notices.popleft()
            response.Parameters.Results = request.results
            self.send_response(request.requesthdr.RequestHandle, request.seqhdr, response)
        if not session.has_subscriptions():
            self.release_publish_requests(Codes.BadNoSubscription)

    def release_publish_requests(self, code: int) -> None:
        """Answer every publish request that waits with a code."""
        while (request := self._next_publish_request()) is not None:
            self._release(request, code)

    def cancel_publish_requests(self, handle: int) -> int:
        """Answer the publish requests of a handle as cancelled, and return how many there were."""
        waiting: Any = self._publish_requests
        cancelled = [one for one in waiting if one.requesthdr.RequestHandle == handle]
        for request in cancelled:
            self._publish_requests.remove(request)
            self._release(request, Codes.BadRequestCancelledByClient)
        return len(cancelled)

    def _release(self, request: Any, code: int) -> None:
        response = ua.ServiceFault()
        response.ResponseHeader.ServiceResult = status(code)
        self.send_response(request.requesthdr.RequestHandle, request.seqhdr, response)

    def _next_publish_request(self) -> Any:
        now = time.monotonic()
        while self._publish_requests:
            request = self._publish_requests.popleft()
            if not request.has_timed_out(now):
                return request
            self._send_publish_request_timeout(request)
        return None

    def _evict_publish_request(self) -> None:
        super()._evict_publish_request()
        if self.session is not None:
            self.session.counts.refused(PUBLISH, Codes.BadTooManyPublishRequests)

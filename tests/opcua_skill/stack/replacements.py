"""What our stack puts in place of asyncua's, and the test that tells when asyncua does as well by itself.

A replacement without a behaviour of its own, because it only puts other replacements in their place, says so in words.
"""

import importlib
import inspect
import pkgutil

from asyncua.common.utils import Buffer
from asyncua.ua import ua_binary

import opcua_skill.stack
from opcua_skill.stack.limits import Limits
from opcua_skill.stack.transport.decoding import install

WIRING = {
    "sessions.SignedIn.__init__": "carries our identity in asyncua's user",
    "calls.CheckedMethods.__init__": "makes our tables and no threads",
    "calls.CheckedMethods.call": "asks for each call apart, so that one's fault is its own",
    "chunks.SecureChannel.__init__": "makes our buffers",
    "filters.EventFilter.__init__": "goes through lists of literals once",
    "internal_server.SkillInternalServer.__init__": "puts our services in place",
    "internal_server.SkillInternalServer.create_session": "makes our session",
    "monitored_items.Items.__init__": "makes our tables",
    "processor.Processor.__init__": "puts our channel in place",
    "publishing.Publishing._evict_publish_request": "counts, then does what asyncua does",
    "server.SkillServer.__init__": "puts our internal server in place",
    "session_services.SessionServices.__init__": "makes our counters",
    "sessions.Session.__init__": "makes our tables; its tokens have a test below",
    "subscribing.SubscribingSession.__init__": "makes room for last words",
    "subscriptions.Subscription.__init__": "puts our items in place",
    "subscriptions.Subscription.set_publishing_mode": "counts, then does what asyncua does",
    "subscriptions.Subscriptions.__init__": "makes the shared encodings",
    "transport.Connection.__init__": "makes our queues",
    "transport.Acceptor.__init__": "makes our counters",
    "transport.Acceptor._make_protocol": "makes our connection",
    "transport.Acceptor.start": "starts what looks after connections",
    "transport.Acceptor.stop": "stops what looks after connections",
}

TESTS = {
    "calls.CheckedMethods._call": ["test_a_call_is_not_checked", "test_a_handler_s_code_is_lost"],
    "calls.CheckedMethods.drain": ["test_a_call_ends_with_its_connection"],
    "capabilities.capabilities": ["test_capabilities_and_diagnostics_are_not_told"],
    "chunks.SecureChannel.message_to_binary": ["test_a_chunk_is_several_objects"],
    "chunks.SecureChannel.receive": ["test_a_message_may_be_as_large_before_sign_in_as_after"],
    "decoding._read": ["test_a_buffer_is_read_backwards"],
    "decoding._skip": ["test_a_buffer_is_read_backwards"],
    "decoding._unpack_bytes": ["test_a_length_below_nothing_is_taken"],
    "decoding._unpack_string": ["test_text_may_be_anything"],
    "decoding._array_decoder": ["test_a_length_below_nothing_is_taken"],
    "decoding._list_decoder": ["test_a_length_below_nothing_is_taken"],
    "decoding._variant": ["test_nesting_has_no_end"],
    "decoding._pack_array": ["test_an_array_that_is_no_list_is_lost"],
    "decoding._enumeration": ["test_a_number_without_a_name_is_a_fault"],
    "decoding._extension_object": ["test_a_structure_with_a_foreign_body_is_a_fault"],
    "decoding.reshape": ["test_dimensions_need_not_fit"],
    "records.security_record": ["test_a_field_called_encoding_is_a_byte"],
    "server_diagnostics.Diagnostics.offer": ["test_capabilities_and_diagnostics_are_not_told"],
    "discovery.Registration.start": ["test_a_discovery_server_that_is_away_is_an_error"],
    "events.deliver": ["test_an_event_does_not_rise_to_the_server"],
    "filters.EventFilter.eval": ["test_a_filter_that_does_not_fit_an_event_is_a_traceback"],
    "filters.EventFilter._eval_op": ["test_a_filter_that_does_not_fit_an_event_is_a_traceback"],
    "filters.EventFilter._eval_el": ["test_of_type_is_for_the_exact_type"],
    "internal_server.SkillInternalServer.stop": ["test_stopping_waits_for_the_clock_s_next_tick"],
    "internal_server._NobodyByDefault.get_user": ["test_any_password_is_good"],
    "internal_server.SkillInternalServer.admit_client": [
        "test_the_certificate_that_is_named_is_the_one_that_is_checked"
    ],
    "monitored_items.Items.create_monitored_items": ["test_an_item_ignores_range_and_filter"],
    "monitored_items.Items._create_events_monitored_item": [
        "test_an_item_ignores_range_and_filter",
        "test_a_full_queue_loses_in_silence",
    ],
    "monitored_items.Items._create_data_change_monitored_item": ["test_an_item_ignores_range_and_filter"],
    "monitored_items.Items._commit_monitored_item": ["test_an_item_that_samples_reports"],
    "monitored_items.Items._set_monitoring_mode": ["test_an_item_that_samples_reports"],
    "monitored_items.Items.modify_monitored_items": ["test_an_item_is_modified_beyond_bounds_or_with_a_fault"],
    "monitored_items.Items._modify_monitored_item": ["test_an_item_is_modified_beyond_bounds_or_with_a_fault"],
    "monitored_items.Items._delete_monitored_items": ["test_what_a_deleted_item_had_queued_is_still_sent"],
    "monitored_items.Items.datachange_callback": ["test_a_node_that_is_gone_is_told_to_the_whole_subscription"],
    "data_filters.moved": ["test_a_deadband_on_text_is_a_fault"],
    "monitored_items.Items._trigger_event": ["test_an_item_that_is_off_hears_events"],
    "processor.Processor.answer": ["test_a_request_is_not_asked_for_its_token"],
    "processor.Processor.take": ["test_a_message_may_be_as_large_before_sign_in_as_after"],
    "processor.Processor.send_response": ["test_an_answer_may_be_larger_than_the_client_takes"],
    "processor.Processor.close": ["test_a_closed_connection_keeps_what_waited"],
    "server.SkillServer.init": ["test_capabilities_and_diagnostics_are_not_told"],
    "server.SkillServer.start": ["test_port_zero_is_told_as_zero"],
    "server.SkillServer.stop": ["test_a_call_ends_with_its_connection"],
    "server.SkillServer._set_endpoints": ["test_a_password_is_encrypted_by_the_channel_alone"],
    "session_services.SessionServices._create_session": ["test_a_connection_may_have_many_sessions"],
    "session_services.SessionServices._activate_session": ["test_a_session_is_attached_before_its_user_is_proven"],
    "sessions.Session.create_session": ["test_the_certificate_that_is_named_is_the_one_that_is_checked"],
    "sessions.Session.activate": ["test_session_tokens_count_up"],
    "sessions.Session.close_session": ["test_a_subscription_may_outlive_its_session"],
    "sessions.Session.read": ["test_a_read_ignores_range_timestamps_and_number"],
    "sessions.Session.browse": ["test_a_browse_has_no_pages"],
    "sessions.Session.browse_next": ["test_a_browse_has_no_pages"],
    "sessions.Session.translate_browsepaths_to_nodeids": ["test_an_unknown_node_is_called_invalid"],
    "sessions.Session.write": ["test_a_write_ignores_range_and_rank"],
    "sessions.Session.history_read": ["test_history_of_a_node_that_is_not_there_is_good"],
    "sessions.Session.call": ["test_a_request_may_have_any_number_of_calls"],
    "subscribing.SubscribingSession.create_subscription": ["test_a_subscription_may_be_as_fast_and_as_many_as_asked"],
    "subscribing.SubscribingSession.modify_subscription": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.delete_subscriptions": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.set_publishing_mode": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.transfer_subscriptions": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.create_monitored_items": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.modify_monitored_items": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.delete_monitored_items": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.set_monitoring_mode": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.republish": ["test_a_subscription_has_no_owner"],
    "subscribing.SubscribingSession.publish": ["test_a_subscription_has_no_owner"],
    "subscriptions.Subscription._pop_triggered_datachanges": ["test_a_value_is_encoded_for_each_subscriber"],
    "subscriptions.Subscription._pop_triggered_events": ["test_a_full_queue_loses_in_silence"],
    "subscriptions.Subscription.has_published_results": ["test_an_item_that_samples_reports"],
    "subscriptions.Subscription._pop_publish_result": ["test_an_item_that_samples_reports"],
    "subscriptions.Subscription.publish_results": [
        "test_a_message_may_have_any_number_of_notifications",
        "test_a_subscription_expires_in_silence",
    ],
    "subscriptions.Subscription._subscription_loop": ["test_a_subscription_cannot_be_modified"],
    "subscriptions.Subscriptions.modify_subscription": ["test_a_subscription_cannot_be_modified"],
    "subscriptions.Subscriptions.create_subscription": ["test_a_subscription_may_be_as_fast_and_as_many_as_asked"],
    "transport.Connection.connection_made": ["test_the_first_to_come_keeps_others_out"],
    "transport.Connection.connection_lost": ["test_a_lost_connection_is_kept_for_a_while"],
    "transport.Connection.data_received": ["test_a_chunk_is_awaited_whatever_size_it_announces"],
    "transport.Connection._process_received_message_loop": ["test_a_call_that_takes_long_holds_up_the_next"],
}


def _modules() -> dict[str, str]:
    """Return the modules of the stack, by the last part of their names."""
    every = pkgutil.walk_packages(opcua_skill.stack.__path__, "opcua_skill.stack.")
    return {one.name.rpartition(".")[2]: one.name for one in every if not one.ispkg}


def overridden() -> set[str]:
    """Return everything of asyncua that is replaced: methods of subclasses, and functions put in place of others."""
    found = set()
    for leaf, place in _modules().items():
        module = importlib.import_module(place)
        for name, ours in vars(module).items():
            if inspect.isclass(ours) and ours.__module__ == module.__name__:
                stock = [base for base in ours.__mro__ if base.__module__.startswith("asyncua")]
                own = {one for one, what in vars(ours).items() if inspect.isfunction(what)}
                found |= {f"{leaf}.{name}.{one}" for one in own if any(one in vars(base) for base in stock)}
    install(Limits())
    for place in (ua_binary, ua_binary._Bytes, ua_binary._String, Buffer):
        for what in vars(place).values():
            function = getattr(what, "__func__", what)
            if getattr(function, "__module__", "") == "opcua_skill.stack.transport.decoding":
                found.add(f"decoding.{function.__name__}")
    return found


def exists(name: str) -> bool:
    """Return whether a replacement that the tables name is there."""
    module, *path = name.split(".")
    found = importlib.import_module(_modules()[module])
    for part in path:
        found = getattr(found, part, None)
    return found is not None

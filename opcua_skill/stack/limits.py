"""How much a peer may ask for. One frozen value; every number is told in docs/reference/security.md."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the server. Sizes in bytes, times in seconds unless the name says milliseconds.

    The defaults serve a plant: some hundred clients, one recording of 20 x 10,000 samples in one call.
    """

    # connections
    connections: int = 200
    connections_per_address: int = 100
    half_open_per_address: int = 20
    hello_timeout: float = 5.0
    activation_timeout: float = 15.0
    chunk_timeout: float = 30.0
    largest_chunk: int = 65_535
    largest_message_before_sign_in: int = 128 * 1024
    largest_message: int = 16 * 1024 * 1024
    largest_answer: int = 16 * 1024 * 1024 - 64 * 1024
    heavy_answer: int = 48 * 1024
    all_unfinished_messages: int = 128 * 1024 * 1024
    queued_chunks: int = 32
    unread_answers: int = 4 * 1024 * 1024
    unread_timeout: float = 10.0
    smallest_client_buffer: int = 8192
    # decoding
    array_of_primitives: int = 2_000_000
    array_of_others: int = 2_000
    elements_per_message: int = 6_000
    string: int = 8 * 1024 * 1024
    nesting: int = 32
    # sessions
    sessions: int = 200
    sessions_tried_per_connection: int = 20
    failed_sign_ins_per_connection: int = 3
    failed_sign_in_delay: float = 0.2
    session_timeout_ms: float = 120_000
    detached_sessions_per_user: int = 3
    # services
    operations_per_request: int = 1_000
    calls_per_request: int = 20
    browses_per_request: int = 250
    path_elements: int = 64
    references_per_browse: int = 1_000
    references_per_request: int = 2_000
    continuation_points: int = 10
    # subscriptions
    subscriptions: int = 500
    subscriptions_per_session: int = 10
    items_per_subscription: int = 1_000
    items: int = 20_000
    queue_of_item: int = 100
    queue_for_events: int = 50
    publishing_interval_ms: tuple[float, float] = (50.0, 3_600_000.0)
    subscription_lifetime: float = 600.0
    unacknowledged_messages: int = 50
    filter_elements: int = 32
    filter_literals: int = 1_000
    selected_fields: int = 100

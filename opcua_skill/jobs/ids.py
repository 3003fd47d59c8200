"""Names of jobs."""

import secrets
from datetime import UTC, datetime


def new_job_id(kind: str) -> str:
    """Return an id that sorts by time and cannot be guessed."""
    return f"{kind}-{datetime.now(UTC):%Y%m%d%H%M%S%f}-{secrets.token_hex(4)}"

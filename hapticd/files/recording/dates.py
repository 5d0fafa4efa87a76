"""The date of a recording, for people: nothing in the daemon is decided by the wall clock."""

from __future__ import annotations

from datetime import UTC, datetime


def utc_now() -> str:
    """The present date and time, such as 2026-11-21T16:40:00.123+00:00."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")

"""Contact records of a report, common to all models.

A record is 9 bytes; its first four, little-endian, hold x (13 bits, signed), y (13 bits, signed, up) and, not on the
Magic Trackpad 1, finger (3) and state (3).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from ...values import Contact

RECORD = struct.Struct("<I5B")  # position and state, major, minor, and three bytes that differ between the models
MAX_RECORDS = 15


class RefusedError(Exception):
    """A report is no touch report, for `reason`. Never leaves this package."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def records(report: bytes, report_id: int, header_bytes: int) -> Iterator[tuple[int, ...]]:
    """Split a report into its records. Raises RefusedError for another report id or a fraction of a record."""
    if not report or report[0] != report_id:
        raise RefusedError("foreign" if report else "length")
    count, rest = divmod(len(report) - header_bytes, RECORD.size)
    if rest != 0 or not 0 <= count <= MAX_RECORDS:
        raise RefusedError("length")
    return RECORD.iter_unpack(report[header_bytes:])


def require_distinct_ids(contacts: tuple[Contact, ...]) -> None:
    """Raise RefusedError for a repeated id: no pad sends one, so the report is torn."""
    if len({contact.contact_id for contact in contacts}) != len(contacts):
        raise RefusedError("duplicate_id")

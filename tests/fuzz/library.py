"""Messages to the client library: a state or a reply, or its HapticdError. A daemon's values are trusted."""

from __future__ import annotations

from contextlib import suppress

import msgpack

from fuzz.target import Cost, Target
from hapticd.wire import client
from hapticd_client.errors import HapticdError
from hapticd_client.messages import decode_state, read_reply
from hapticd_contract.states import EventKind, FingerState, PlateEvent, PlateState

FINGER = FingerState("ghost", 1.0, 2.0, 1.5, None, None, 0.5, True)
EVENT = PlateEvent(7, EventKind.BEGUN, 2**40, 2**39, 3, 1.0, -2.0, "study", "", "click")
STATE = PlateState(99, 12, 2**40, "active", (FINGER,), (1.0, -4.0), True, 10.5, 16.0, events=(EVENT,))


def check(data: bytes) -> None:
    with suppress(HapticdError):
        assert isinstance(decode_state(data), PlateState)
    with suppress(HapticdError):
        body = read_reply(data, 7)
        assert body is None or isinstance(body, dict)


def seeds() -> dict[str, bytes]:
    return {
        "state": client.encode_state(STATE),
        "reply": client.encode_reply(7, {"a": [1, 2.5]}),
        "error": client.encode_error(7, "finger 3 is held by 'other'."),
        "unread": client.encode_error(0, "no."),
        "late": client.encode_reply(8, {}),
        "text for a number": bytes(
            msgpack.packb(msgpack.unpackb(client.encode_state(STATE)) | {"modal_um": ["much"], "age_ms": "old"})
        ),
    }


def extremes() -> dict[str, bytes]:
    return {"brackets": b"\x91" * 65536, "claims": b"\xdd\xff\xff\xff\xff", "bytes": b"\xc6\xff\xff\xff\xff"}


TARGET = Target(
    name="library",
    check=check,
    seeds=seeds,
    fixed=Cost(500, 300_000),
    per_byte=Cost(10, 200),
    extremes=extremes,
)

"""Texts of a WebSocket: RefusedMessage in a short sentence, or a message that the daemon reads as the gateway did."""

from __future__ import annotations

import base64
import json
from typing import Any

from fuzz.client import BODY, LONGEST_SENTENCE
from fuzz.target import Cost, Target
from hapticd.tools.gateway import messages
from hapticd.wire.client import decode_request, decode_targets
from hapticd_contract.base import MAX_MESSAGE_BYTES
from hapticd_contract.requests import UNREAD_REQUEST_ID
from hapticd_contract.targets import TargetsMessage
from hapticd_contract.web import Follow


def check(data: bytes) -> None:
    """A text of any characters."""
    try:
        message = messages.decode(data.decode("utf-8", "replace"))
        payload = b"" if isinstance(message, Follow) else messages.encode(message)
    except messages.RefusedMessage as error:
        check_refusal(str(error), error.request_id)
        return
    assert len(payload) <= MAX_MESSAGE_BYTES
    if isinstance(message, Follow):
        assert message.states in ("newest", "every", "none")
    elif isinstance(message, TargetsMessage):
        assert decode_targets(payload) == message
    else:
        assert decode_request(payload) == message


def check_refusal(sentence: str, request_id: int) -> None:
    assert 0 < len(sentence) <= LONGEST_SENTENCE
    assert UNREAD_REQUEST_ID <= request_id < 2**32
    assert json.loads(messages.refusal(sentence, request_id))["ok"] is False


def as_json(value: Any) -> bytes:
    return json.dumps(value, default=lambda one: base64.b64encode(one).decode()).encode()


def seeds() -> dict[str, bytes]:
    part = {"client": "page", "asset": bytes(32), "size": 6, "offset": 0, "part": b"abcdef"}
    surfaces: Any = BODY["surfaces"]
    sound = [one | {"polygon_mm": [[0, 0], [9, 0], [9, 9]]} if "polygon_mm" in one else one for one in surfaces]
    return {
        "targets": as_json({"v": 1, **BODY, "surfaces": sound}),
        "set": as_json(
            {"v": 1, "id": 7, "op": "set", "body": {"client": "page", "targets": [{"finger": 1, "friction": 0}]}}
        ),
        "marker": as_json(
            {
                "v": 1,
                "id": 8,
                "op": "marker",
                "body": {"client": "page", "text": "go", "fields": {"trial": 7, "is": True}},
            }
        ),
        "asset": as_json({"v": 1, "id": 9, "op": "asset", "body": part}),
        "reach": as_json({"v": 1, "id": 10, "op": "reach", "body": {"x_mm": 1, "y_mm": -2.5}}),
        "hello": as_json({"v": 1, "id": 11, "op": "hello"}),
        "follow": as_json({"v": 1, "states": "every"}),
        "deep": b'{"v": 1, "targets": [[[[[[[[]]]]]]]]}',
        "twice": b'{"v": 1, "v": 1, "client": "page", "ttl_s": NaN}',
    }


TARGET = Target(name="gateway", check=check, seeds=seeds, fixed=Cost(1000, 50_000), per_byte=Cost(8, 200), max_len=8192)

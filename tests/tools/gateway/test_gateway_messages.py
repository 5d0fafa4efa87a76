"""The gateway's JSON is the contract's, and no text raises anything but a refusal."""

from __future__ import annotations

import base64
import json
from typing import Any, get_args

import pytest
from msgspec import inspect as types

from hapticd.tools.gateway import messages
from hapticd.tools.gateway.messages import RefusedMessage
from hapticd.tools.web.sockets import BYTE_FIELDS
from hapticd.wire import client as wire
from hapticd_contract.base import MAX_MESSAGE_BYTES
from hapticd_contract.requests import AssetRequest, Request
from hapticd_contract.targets import TargetsMessage

DIGEST = base64.b64encode(bytes(32)).decode()
TARGETS: dict[str, Any] = {
    "v": 1,
    "client": "page",
    "targets": [
        {"finger": 3, "friction": 0.2},
        {"finger": 4, "map": {"width": 2, "height": 2, "levels": "AP8A/w==", "high_um": 2}},
    ],
}


def test_targets_reach_the_daemon_as_they_are_with_base64_as_bytes() -> None:
    message = messages.decode(json.dumps(TARGETS))
    assert isinstance(message, TargetsMessage)
    assert messages.client_of(message) == "page"
    decoded = wire.decode_targets(messages.encode(message))
    assert decoded == message
    assert decoded.targets[1].map is not None
    assert decoded.targets[1].map.levels == b"\x00\xff\x00\xff"


def test_a_request_reaches_the_daemon_as_it_is() -> None:
    body = {"client": "page", "asset": DIGEST, "size": 3, "offset": 0, "part": "AAEC"}
    message = messages.decode(json.dumps({"v": 1, "id": 9, "op": "asset", "body": body}))
    assert isinstance(message, AssetRequest)
    assert (message.body.part, messages.client_of(message)) == (b"\x00\x01\x02", "page")
    assert wire.decode_request(messages.encode(message)) == message


def test_a_field_that_holds_bytes_somewhere_holds_a_text_nowhere() -> None:
    texts: set[str] = set()
    for request in get_args(Request):
        info = types.type_info(request)
        assert isinstance(info, types.StructType)
        for field in info.fields:
            inner = field.type.fields if isinstance(field.type, types.StructType) else (field,)
            texts |= {one.encode_name for one in inner if isinstance(one.type, types.StrType)}
    assert {"client", "text"} <= texts
    assert not texts & BYTE_FIELDS


@pytest.mark.parametrize(
    "text",
    [
        '{"v": 1.0, "client": "a", "stamp": 7.0}',
        '{"v": 1.0, "client": "a", "targets": [{"finger": 3.0, "friction": 1.0, "priority": 2.0}]}',
        '{"v": 1, "client": "a", "surfaces": [{"name": "b", "z": -4.0, "amplitude_um": 1.5}]}',
        '{"v": 1.0, "id": 9.0, "op": "hello"}',
        '{"v": 1.0, "states": "newest"}',
    ],
)
def test_a_whole_number_written_as_a_float_is_one(text: str) -> None:
    assert repr(messages.decode(text)) == repr(messages.decode(text.replace(".0", "")))


@pytest.mark.parametrize(
    ("text", "request_id", "sentence"),
    [
        ("{", 0, "The message is not JSON, or too deep."),
        ("[1]", 0, "The message must be a map, not a list."),
        ('{"v": 2, "client": "a"}', 0, "The message has protocol version 2, the daemon has 1: update the daemon."),
        ('{"v": 1.5, "client": "a"}', 0, "v: must be 1."),
        ('{"v": 1, "client": "a", "targets": [{"finger": 1.5, "friction": 0}]}', 0, "targets[0].finger: must be"),
        ('{"v": 1, "id": 3, "op": "release", "body": {"client": "a", "finger": 1.5}}', 3, "body.finger: must be"),
        ('{"v": 1, "states": "all"}', 0, "states: must be one of "),
        ('{"v": 1, "id": 3, "op": "dance"}', 3, "op: must be one of hello, "),
        ('{"v": 1, "id": 5000000000, "op": "dance"}', 0, "op: must be one of hello, "),
        ('{"v": 1, "id": 3, "op": "hello", "more": 1}', 3, "more: unknown field"),
        (
            '{"v": 1, "id": 3, "op": "asset", "body": {"client": "a", "size": 1, "asset": "?"}}',
            3,
            "body.asset: must be bytes (base64 in JSON)",
        ),
    ],
)
def test_a_wrong_text_is_refused_in_a_sentence(text: str, request_id: int, sentence: str) -> None:
    with pytest.raises(RefusedMessage) as refused:
        messages.decode(text)
    assert str(refused.value).startswith(sentence)
    assert refused.value.request_id == request_id


def test_what_is_too_long_for_the_daemon_is_refused_here() -> None:
    levels = base64.b64encode(bytes(128 * 128)).decode()
    one = {"width": 128, "height": 128, "high_um": 2, "levels": levels}
    targets = [{"finger": finger, "map": one} for finger in range(1, 6)]
    message = messages.decode(json.dumps({"v": 1, "client": "page", "targets": targets}))
    assert isinstance(message, TargetsMessage)
    with pytest.raises(RefusedMessage, match=f"the limit is {MAX_MESSAGE_BYTES}"):
        messages.encode(message)


def test_replies_are_readable_by_every_language() -> None:
    reply = json.loads(messages.text_of(wire.encode_reply(3, {"shapes": b"\x01\x02", "drive_hz": None})))
    assert reply == {"v": 1, "id": 3, "ok": True, "body": {"shapes": "AQI=", "drive_hz": None}}
    assert json.loads(messages.refusal("No.", 4)) == {"v": 1, "id": 4, "ok": False, "error": "No."}

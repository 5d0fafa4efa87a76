"""Messages from clients: RequestError in a short sentence, or values within the documented bounds."""

from __future__ import annotations

import math

import msgpack

from fuzz.target import Cost, Target
from hapticd.errors import RequestError
from hapticd.values import ClientTargets
from hapticd.wire.client import (
    MAX_MARKER_CHARACTERS,
    PROTOCOL_VERSION,
    UNREAD_REQUEST_ID,
    Marker,
    Release,
    Request,
    answer,
    decode_request,
    decode_targets,
)
from hapticd.wire.fields import MAX_BINARY_BYTES, MAX_PAYLOAD_BYTES
from hapticd.wire.targets import MAX_AMPLITUDE_UM, MAX_PATH_POINTS, MAX_POSITION_MM, MAX_TARGETS, MAX_VIRTUALS

LONGEST_SENTENCE = 250

BODY: dict[str, object] = {
    "client": "study-7",
    "ttl_s": 0.25,
    "targets": [
        {"finger": 3, "amplitude_um": 1.5},
        {"finger": 4, "friction": 1},
        {"finger": "ghost", "grating": {"period_mm": 5.0, "angle_rad": 0.5, "high_um": 2, "duty_frac": 0.25}},
        {"finger": 6, "map": {"width": 2, "height": 3, "levels": bytes(6), "high_um": 3}},
    ],
    "virtuals": [{"name": "ghost", "path_mm": [[-40, 20], [40.5, 20]], "speed_mm_s": 80, "loop": False}],
}


def check(data: bytes) -> None:
    """The same bytes as a message of the `targets` socket and of the `control` socket."""
    try:
        check_targets(decode_targets(data))
    except RequestError as error:
        check_sentence(str(error))
    try:
        request: Request | None = decode_request(data)
    except RequestError as error:
        check_sentence(str(error))
        request = None
    if request is not None and isinstance(request.body, ClientTargets):
        check_targets(request.body)
    check_answer(data, request)


def check_sentence(sentence: str) -> None:
    assert sentence.isprintable()
    assert sentence.endswith(".")
    assert len(sentence) <= LONGEST_SENTENCE


def check_targets(wanted: ClientTargets) -> None:
    assert 20_000_000 <= wanted.ttl_ns <= 5_000_000_000
    assert len(wanted.targets) <= MAX_TARGETS
    assert len(wanted.virtuals) <= MAX_VIRTUALS
    for target in wanted.targets.values():
        for name in ("amplitude_um", "friction_frac", "low_um", "high_um", "period_mm", "duty_frac"):
            assert 0 <= getattr(target, name, 0.0) <= MAX_AMPLITUDE_UM
        assert len(getattr(target, "levels", b"")) <= MAX_BINARY_BYTES
        assert math.isfinite(getattr(target, "angle_rad", 0.0))
    for path in wanted.virtuals.values():
        assert 1 <= len(path.points_mm) <= MAX_PATH_POINTS
        assert all(abs(part) <= MAX_POSITION_MM for point in path.points_mm for part in point)


def check_answer(data: bytes, request: Request | None) -> None:
    """Every message has one reply, and it says yes exactly to what is understood."""
    reply = msgpack.unpackb(answer(data, lambda _: {}))
    assert reply["ok"] is (request is not None)
    if request is not None:
        assert reply["id"] == request.id != UNREAD_REQUEST_ID
        assert request.body is None or isinstance(request.body, (ClientTargets, Release, Marker))
        if isinstance(request.body, Marker):
            assert 1 <= len(request.body.text) <= MAX_MARKER_CHARACTERS
            assert request.body.text.isprintable()


def packed(message: dict[str, object]) -> bytes:
    return bytes(msgpack.packb({"v": PROTOCOL_VERSION, **message}))


def seeds() -> dict[str, bytes]:
    found = {f"op-{op}": packed({"id": 7, "op": op}) for op in ("hello", "capabilities", "status", "clear_fault")}
    found |= {
        "targets": packed(BODY),
        "least": packed({"client": "c"}),
        "set": packed({"id": 2**32 - 1, "op": "set", "body": BODY}),
        "release": packed({"id": 1, "op": "release", "body": {"client": "a", "finger": "ghost"}}),
        "release-all": packed({"id": 1, "op": "release", "body": {"client": "a"}}),
        "marker": packed({"id": 5, "op": "marker", "body": {"client": "a", "text": "trial 7: \xb5m"}}),
        "later": bytes(msgpack.packb({"v": 2, "id": 1, "op": "hello"})),
        "deep": b"\x91" * 600,
    }
    return found


def extremes() -> dict[str, bytes]:
    """As long as a message may be, in the ways that cost a reader most."""
    paths = [{"name": f"{n:032}", "path_mm": [[n, n]] * MAX_PATH_POINTS} for n in range(MAX_VIRTUALS)]
    image = {"width": 128, "height": 128, "levels": bytes(128 * 128), "high_um": 1}
    targets = [{"finger": n + 1, "map": image} for n in (1, 2)]
    return {
        "longest": packed({"client": "a", "virtuals": paths, "targets": targets}),
        "brackets": b"\x91" * MAX_PAYLOAD_BYTES,
        "maps": b"\x81\xa1v" * (MAX_PAYLOAD_BYTES // 3),
        "wide": b"\xdc\x00\x40" + b"\xdc\x00\x40" * 63 + b"\xc0" * (MAX_PAYLOAD_BYTES - 192),
        "too long": bytes(MAX_PAYLOAD_BYTES + 1),
        "claims": b"\xdd\xff\xff\xff\xff",
    }


TARGET = Target(
    name="client",
    check=check,
    seeds=seeds,
    fixed=Cost(3000, 300_000),
    per_byte=Cost(30, 200),
    extremes=extremes,
)

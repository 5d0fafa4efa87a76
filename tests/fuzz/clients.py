"""Messages of clients: a documented error, or values in bounds."""

from __future__ import annotations

import math

import msgpack
import msgspec

from fuzz.target import Cost, Target
from hapticd.core.targets.forms import Course
from hapticd.core.targets.scene import Scene
from hapticd.errors import RequestError
from hapticd.wire.client import answer, decode_request, decode_targets
from hapticd_contract import base, effects, requests, surfaces, targets

LONGEST_SENTENCE = 250
LONGEST_LIST = max(targets.MAX_TARGETS, targets.MAX_SURFACES, surfaces.MAX_PATH_POINTS, surfaces.MAX_POLYGON_POINTS)


def check_client(data: bytes) -> bool:
    """The same bytes as a message of the `targets` socket and of the `control` socket."""
    requested: targets.ClientTargets | None = None
    request: requests.Request | None = None
    try:
        requested = decode_targets(data)
    except RequestError as error:
        check_sentence(str(error))
    try:
        request = decode_request(data)
    except RequestError as error:
        check_sentence(str(error))
    for one in (requested, request.body if isinstance(request, requests.SetRequest) else None):
        if one is not None:
            check_targets(one)
    check_answer(data, request)
    return requested is not None or request is not None


def check_sentence(sentence: str) -> None:
    assert sentence.isprintable()
    assert sentence.endswith(".")
    assert len(sentence) <= LONGEST_SENTENCE


def check_targets(requested: targets.ClientTargets) -> None:
    """What a scene takes of it stays finite, and needs a bounded number of knots, at every instant of a clock."""
    assert 20_000_000 <= requested.ttl_ns <= 5_000_000_000
    check_numbers(msgspec.to_builtins(requested))
    assert all(name in [one.name for one in requested.surfaces] for one in requested.effects for name in one.surfaces)
    scene = Scene(w_limit_um=4.0)
    scene.set_targets(requested, 0)
    for layer in scene.surfaces.layers:
        for t_ns in (0, 10**18, 2**63 - 1):
            assert all(math.isfinite(part) for part in layer.local_mm(3.0, 4.0, t_ns))
            assert layer.amplitude_um(3.0, 4.0, t_ns) <= 4.0
            assert all(0 <= turn_ns <= 10**7 for turn_ns in layer.turns_ns(t_ns, 10**7, 8))
    for course in [Course(effect.form, effect.loops) for effect in requested.effects]:
        assert course.length_ns > 0
        assert all(math.isfinite(course.value(since_ns)) for since_ns in (-1, 0, 10**6, 10**9 + 1, 2**62))
        assert len(course.corners_ns(10**9, 10**9 + 10**6)) <= effects.MAX_ENVELOPE_POINTS + 4


def check_numbers(value: object) -> None:
    """None is beyond what any field takes, and no list is longer."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        assert len(value) <= LONGEST_LIST
        for item in value:
            check_numbers(item)
    elif isinstance(value, float):
        assert abs(value) <= base.MAX_POSITION_MM


def check_answer(data: bytes, request: requests.Request | None) -> None:
    """Every message has one reply, and it says yes exactly to what is understood."""
    reply = msgpack.unpackb(answer(data, lambda _: {}))
    assert reply["ok"] is (request is not None)
    if request is not None:
        assert reply["id"] == request.id != requests.UNREAD_REQUEST_ID
    if isinstance(request, requests.AssetRequest):
        part = request.body
        assert len(part.asset) == 32
        assert (part.offset or 0) + len(part.part or b"") <= part.size <= requests.MAX_ASSET_BYTES
    if isinstance(request, requests.MarkRequest):
        assert 1 <= len(request.body.text) <= requests.MAX_MARKER_CHARACTERS
        assert request.body.text.isprintable()


def client_extremes() -> dict[str, bytes]:
    """As long as a message may be, in the ways that cost a reader most."""

    def packed(**body: object) -> bytes:
        return bytes(msgpack.packb({"v": base.PROTOCOL_VERSION, "client": "a", **body}))

    names = [f"{n:032}" for n in range(targets.MAX_SURFACES)]
    paths = [{"name": name, "path_mm": [[1, 1]] * surfaces.MAX_PATH_POINTS} for name in names[: targets.MAX_VIRTUALS]]
    image = {"width": 128, "height": 128, "levels": bytes(128 * 128), "high_um": 1}
    star = [[math.cos(2.4 * n), math.sin(2.4 * n)] for n in range(surfaces.MAX_POLYGON_POINTS)]
    thick = {"points": [[0.01 * n, 1.5] for n in range(effects.MAX_ENVELOPE_POINTS)]}
    long = {"name": "a", "envelope": {"points": [[n, 0] for n in range(10_000)]}}
    endless = {"name": "a", "amplitude_um": 1, "polygon_mm": [[0, 0]] * 10_000}
    return {
        "envelopes": packed(effects=[{"name": name, "envelope": thick} for name in names[:4]]),
        "an envelope of 10000 points": packed(effects=[long]),
        "longest": packed(virtuals=paths, targets=[{"finger": n, "map": image} for n in (2, 3)]),
        "polygons": packed(surfaces=[{"name": name, "amplitude_um": 1, "polygon_mm": star} for name in names]),
        "a polygon of 10000 points": packed(surfaces=[endless]),
        "brackets": b"\x91" * base.MAX_MESSAGE_BYTES,
        "maps": b"\x81\xa1v" * (base.MAX_MESSAGE_BYTES // 3),
        "wide": b"\xdc\x00\x40" + b"\xdc\x00\x40" * 63 + b"\xc0" * (base.MAX_MESSAGE_BYTES - 192),
        "too long": bytes(base.MAX_MESSAGE_BYTES + 1),
        "claims": b"\xdd\xff\xff\xff\xff",
    }


TARGETS = (Target("client", check_client, Cost(3000, 300_000), Cost(30, 200)),)

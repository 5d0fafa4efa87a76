"""Messages of clients, of the gateway's pages, and to the client library: a documented error, or values in bounds."""

from __future__ import annotations

import json
import math
from contextlib import suppress
from itertools import pairwise

import msgpack
from msgspec.structs import replace

from fuzz.target import Cost, Target
from hapticd.core.targets.forms import Course
from hapticd.core.targets.scene import Scene
from hapticd.errors import RequestError
from hapticd.tools.gateway import messages
from hapticd.wire.client import answer, decode_request, decode_targets
from hapticd_client.errors import HapticdError
from hapticd_client.messages import decode_state, read_reply
from hapticd_contract import base, contents, effects, requests, surfaces, targets
from hapticd_contract.states import PlateState
from hapticd_contract.web import Follow

LONGEST_SENTENCE = 250


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
    assert 20_000_000 <= requested.ttl_ns <= 5_000_000_000
    assert len(requested.targets) <= targets.MAX_TARGETS
    assert len(requested.virtuals) <= targets.MAX_VIRTUALS
    for target in [one.content for one in requested.targets]:
        for name in ("amplitude_um", "friction", "low_um", "high_um", "period_mm", "duty_frac"):
            value = getattr(target, name, None)
            for number in value if isinstance(value, tuple) else (value or 0.0,):
                assert 0 <= number <= base.MAX_AMPLITUDE_UM
        assert len(getattr(target, "levels", b"")) <= base.MAX_PART_BYTES
        assert 0.1 <= getattr(target, "shortest_mm", 1.0) <= getattr(target, "longest_mm", 1000.0) <= 1000.0
        assert math.isfinite(getattr(target, "angle_rad", 0.0))
    assert len(requested.surfaces) <= targets.MAX_SURFACES
    for surface in requested.surfaces:
        check_surface(surface)
    assert len(requested.effects) <= targets.MAX_EFFECTS
    for effect in requested.effects:
        check_effect(effect, requested)
    for path in requested.virtuals:
        assert 1 <= len(path.path_mm) <= surfaces.MAX_PATH_POINTS
        assert all(abs(part) <= base.MAX_POSITION_MM for point in path.path_mm for part in point)


def check_surface(surface: surfaces.Surface) -> None:
    """Where it is and what it covers stays finite at every instant that a clock can show."""
    scene = Scene(w_limit_um=4.0)
    still = replace(surface, **(dict.fromkeys(contents.CONTENTS) | {"amplitude_um": 1.0}))  # that every plate takes
    assert scene.set_targets(targets.ClientTargets.of("c", 1, {}, {}, surfaces={"one": still}), 0) == ()
    (layer,) = scene.surfaces.layers
    for t_ns in (0, 10**18, 2**63 - 1):
        assert all(math.isfinite(part) for part in layer.local_mm(3.0, 4.0, t_ns))
        assert layer.amplitude_um(3.0, 4.0, t_ns) <= 4.0
        assert all(0 <= turn_ns <= 10**7 for turn_ns in layer.turns_ns(t_ns, 10**7, 8))
    if isinstance(surface.shape, surfaces.Polygon):
        assert 3 <= len(surface.shape.corners_mm) <= surfaces.MAX_POLYGON_POINTS
        assert all(abs(part) <= base.MAX_POSITION_MM for point in surface.shape.corners_mm for part in point)


def check_effect(effect: effects.Effect, requested: targets.ClientTargets) -> None:
    """What plays stays finite and needs a bounded number of knots, at every instant that a clock can show."""
    assert all(name in [one.name for one in requested.surfaces] for name in effect.surfaces)
    if isinstance(effect.start, effects.OnPressure):
        assert 0.0 <= effect.start.release_frac < effect.start.threshold <= 1.0
    match effect.form:
        case effects.Pulse(height_um, length_s) as pulse:
            assert abs(height_um) <= base.MAX_AMPLITUDE_UM
            assert 0.0 <= 2.0 * pulse.ramp_s <= length_s <= effects.MAX_LENGTH_S
        case effects.Envelope(points):
            assert 2 <= len(points) <= effects.MAX_ENVELOPE_POINTS
            assert all(before[0] <= after[0] <= effects.MAX_LENGTH_S for before, after in pairwise(points))
            assert all(abs(value) <= base.MAX_AMPLITUDE_UM for _, value in points)
        case effects.Modulation(frequency_hz, depth):
            assert 1.0 <= frequency_hz <= 300.0
            assert 0.0 <= depth <= 1.0
    course = Course(effect.form, effect.loops)
    assert course.length_ns > 0
    assert all(math.isfinite(course.value(since_ns)) for since_ns in (-1, 0, 10**6, 10**9 + 1, 2**62))
    assert len(course.corners_ns(10**9, 10**9 + 10**6)) <= effects.MAX_ENVELOPE_POINTS + 4


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


def check_gateway(data: bytes) -> bool:
    """A text of any characters: refused in a short sentence, or a message that the daemon reads as the gateway did."""
    try:
        message = messages.decode(data.decode("utf-8", "replace"))
        payload = b"" if isinstance(message, Follow) else messages.encode(message)
    except messages.RefusedMessage as error:
        check_refusal(str(error), error.request_id)
        return False
    assert len(payload) <= base.MAX_MESSAGE_BYTES
    if isinstance(message, Follow):
        assert message.states in ("newest", "every", "none")
    elif isinstance(message, targets.TargetsMessage):
        assert decode_targets(payload) == message
    else:
        assert decode_request(payload) == message
    return True


def check_refusal(sentence: str, request_id: int) -> None:
    assert 0 < len(sentence) <= LONGEST_SENTENCE
    assert requests.UNREAD_REQUEST_ID <= request_id < 2**32
    assert json.loads(messages.refusal(sentence, request_id))["ok"] is False


def check_library(data: bytes) -> bool:
    """A state or a reply, or the library's error. A daemon's values are trusted."""
    found = False
    with suppress(HapticdError):
        assert isinstance(decode_state(data), PlateState)
        found = True
    with suppress(HapticdError):
        body = read_reply(data, 7)
        assert body is None or isinstance(body, dict)
    return found


def library_extremes() -> dict[str, bytes]:
    return {"brackets": b"\x91" * 65536, "claims": b"\xdd\xff\xff\xff\xff", "bytes": b"\xc6\xff\xff\xff\xff"}


TARGETS = (
    Target("client", check_client, Cost(3000, 300_000), Cost(30, 200), extremes=client_extremes),
    Target("gateway", check_gateway, Cost(1000, 50_000), Cost(8, 200), max_len=8192),
    Target("library", check_library, Cost(500, 300_000), Cost(10, 200), extremes=library_extremes),
)

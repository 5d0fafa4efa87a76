"""Messages from clients: RequestError in a short sentence, or values within the documented bounds."""

from __future__ import annotations

import math
from itertools import pairwise

import msgpack
from msgspec.structs import replace

from fuzz.target import Cost, Target
from hapticd.core.targets.forms import Course
from hapticd.core.targets.layer import Layer
from hapticd.core.targets.scene import Scene
from hapticd.errors import RequestError
from hapticd.wire.client import answer, decode_request, decode_targets
from hapticd_contract.base import (
    MAX_AMPLITUDE_UM,
    MAX_MESSAGE_BYTES,
    MAX_PART_BYTES,
    MAX_POSITION_MM,
    PROTOCOL_VERSION,
)
from hapticd_contract.contents import CONTENTS
from hapticd_contract.effects import (
    MAX_ENVELOPE_POINTS,
    MAX_LENGTH_S,
    Effect,
    Envelope,
    Modulation,
    OnPressure,
    Pulse,
)
from hapticd_contract.requests import (
    MAX_ASSET_BYTES,
    MAX_MARKER_CHARACTERS,
    UNREAD_REQUEST_ID,
    AssetRequest,
    MarkRequest,
    Request,
    SetRequest,
)
from hapticd_contract.surfaces import MAX_PATH_POINTS, MAX_POLYGON_POINTS, Polygon, Surface
from hapticd_contract.targets import MAX_EFFECTS, MAX_SURFACES, MAX_TARGETS, MAX_VIRTUALS, ClientTargets

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
    "surfaces": [
        {"name": "disc", "amplitude_um": 1, "circle_mm": 4.0, "position_mm": [3, -4], "z": -2, "blend": "max"},
        {"name": "tile", "friction": 0.5, "rectangle_mm": [3, 24], "angle_rad": 0.5, "scale": 2, "turning_rad_s": -1},
        {
            "name": "bow",
            "grating": {"period_mm": 5.0, "high_um": 2},
            "polygon_mm": [[0, 0], [9, 0], [0, 5.5], [9, 9]],
            "velocity_mm_s": [300, -20],
            "t_pose_ns": 10**12,
        },
        {
            "name": "walk",
            "gradient": {"length_mm": 9, "to_um": 2},
            "circle_mm": 5,
            "path_mm": [[0, 0], [9, -9], [0, 0]],
        },
        {
            "name": "rough",
            "noise": {"shortest_mm": 1, "longest_mm": 9.5, "exponent": 0.5, "mean_um": 1, "rms_um": 0.25, "seed": 7},
        },
        {"name": "photo", "map": {"width": 2, "height": 2, "asset": bytes(32), "friction": [1, 0.5]}},
    ],
    "effects": [
        {"name": "click", "pulse": {"height_um": -1, "length_s": 0.01}, "start": {"cause": "pressure", "threshold": 1}},
        {"name": "hum", "modulation": {"frequency_hz": 250, "depth": 0.5}, "finger": 3, "start": {"cause": "landing"}},
        {
            "name": "wave",
            "envelope": {"points": [[0, 1], [0.01, 0], [0.01, 2]], "is_factor": True},
            "surface": "bow",
            "start": {"cause": "crossing", "surface": "disc"},
        },
        {"name": "beep", "pulse": {"height_um": 1, "length_s": 9}, "start": {"cause": "at", "t_ns": 7}, "loops": True},
    ],
}

PART: dict[str, object] = {"client": "a", "asset": bytes(range(32)), "size": 9, "offset": 4, "part": b"abcde"}


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
    if isinstance(request, SetRequest):
        check_targets(request.body)
    check_answer(data, request)


def check_sentence(sentence: str) -> None:
    assert sentence.isprintable()
    assert sentence.endswith(".")
    assert len(sentence) <= LONGEST_SENTENCE


def check_targets(requested: ClientTargets) -> None:
    assert 20_000_000 <= requested.ttl_ns <= 5_000_000_000
    assert len(requested.targets) <= MAX_TARGETS
    assert len(requested.virtuals) <= MAX_VIRTUALS
    for target in [one.content for one in requested.targets]:
        for name in ("amplitude_um", "friction", "low_um", "high_um", "period_mm", "duty_frac"):
            value = getattr(target, name, None)
            for number in value if isinstance(value, tuple) else (value or 0.0,):
                assert 0 <= number <= MAX_AMPLITUDE_UM
        assert len(getattr(target, "levels", b"")) <= MAX_PART_BYTES
        assert 0.1 <= getattr(target, "shortest_mm", 1.0) <= getattr(target, "longest_mm", 1000.0) <= 1000.0
        assert math.isfinite(getattr(target, "angle_rad", 0.0))
    assert len(requested.surfaces) <= MAX_SURFACES
    for surface in requested.surfaces:
        check_surface(surface)
    assert len(requested.effects) <= MAX_EFFECTS
    for effect in requested.effects:
        check_effect(effect, requested)
    for path in requested.virtuals:
        assert 1 <= len(path.path_mm) <= MAX_PATH_POINTS
        assert all(abs(part) <= MAX_POSITION_MM for point in path.path_mm for part in point)


def check_surface(surface: Surface) -> None:
    """Where it is and what it covers stays finite at every instant that a clock can show."""
    (layer,) = layers_of(surface)
    for t_ns in (0, 10**18, 2**63 - 1):
        assert all(math.isfinite(part) for part in layer.local_mm(3.0, 4.0, t_ns))
        assert layer.amplitude_um(3.0, 4.0, t_ns) <= 4.0
        assert all(0 <= turn_ns <= 10**7 for turn_ns in layer.turns_ns(t_ns, 10**7, 8))
    if isinstance(surface.shape, Polygon):
        assert 3 <= len(surface.shape.corners_mm) <= MAX_POLYGON_POINTS
        assert all(abs(part) <= MAX_POSITION_MM for point in surface.shape.corners_mm for part in point)


def check_effect(effect: Effect, requested: ClientTargets) -> None:
    assert all(name in [one.name for one in requested.surfaces] for name in effect.surfaces)
    if isinstance(effect.start, OnPressure):
        assert 0.0 <= effect.start.release_frac < effect.start.threshold <= 1.0
    match effect.form:
        case Pulse(height_um, length_s) as pulse:
            assert abs(height_um) <= MAX_AMPLITUDE_UM
            assert 0.0 <= 2.0 * pulse.ramp_s <= length_s <= MAX_LENGTH_S
        case Envelope(points):
            assert 2 <= len(points) <= MAX_ENVELOPE_POINTS
            assert all(before[0] <= after[0] <= MAX_LENGTH_S for before, after in pairwise(points))
            assert all(abs(value) <= MAX_AMPLITUDE_UM for _, value in points)
        case Modulation(frequency_hz, depth):
            assert 1.0 <= frequency_hz <= 300.0
            assert 0.0 <= depth <= 1.0
    check_course(effect)


def check_course(effect: Effect) -> None:
    """What plays stays finite and needs a bounded number of knots, at every instant that a clock can show."""
    course = Course(effect.form, effect.loops)
    assert course.length_ns > 0
    for since_ns in (-1, 0, 10**6, 10**9 + 1, 2**62):
        assert math.isfinite(course.value(since_ns))
    assert len(course.corners_ns(10**9, 10**9 + 10**6)) <= MAX_ENVELOPE_POINTS + 4


def layers_of(surface: Surface) -> list[Layer]:
    """The surface in force, with content that every plate takes."""
    scene = Scene(w_limit_um=4.0)
    still = replace(surface, **(dict.fromkeys(CONTENTS) | {"amplitude_um": 1.0}))
    assert scene.set_targets(ClientTargets.of("c", 1, {}, {}, surfaces={"one": still}), 0) == ()
    return scene.surfaces.layers


def check_answer(data: bytes, request: Request | None) -> None:
    """Every message has one reply, and it says yes exactly to what is understood."""
    reply = msgpack.unpackb(answer(data, lambda _: {}))
    assert reply["ok"] is (request is not None)
    if request is not None:
        assert reply["id"] == request.id != UNREAD_REQUEST_ID
    if isinstance(request, AssetRequest):
        part = request.body
        assert len(part.asset) == 32
        assert (part.offset or 0) + len(part.part or b"") <= part.size <= MAX_ASSET_BYTES
    if isinstance(request, MarkRequest):
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
        "asset": packed({"id": 6, "op": "asset", "body": PART}),
        "later": bytes(msgpack.packb({"v": 2, "id": 1, "op": "hello"})),
        "deep": b"\x91" * 600,
    }
    return found


def extremes() -> dict[str, bytes]:
    """As long as a message may be, in the ways that cost a reader most."""
    paths = [{"name": f"{n:032}", "path_mm": [[n, n]] * MAX_PATH_POINTS} for n in range(MAX_VIRTUALS)]
    image = {"width": 128, "height": 128, "levels": bytes(128 * 128), "high_um": 1}
    targets = [{"finger": n + 1, "map": image} for n in (1, 2)]
    star = [[math.cos(2.4 * n), math.sin(2.4 * n)] for n in range(MAX_POLYGON_POINTS)]
    polygons = [{"name": f"{n:032}", "amplitude_um": 1, "polygon_mm": star} for n in range(MAX_SURFACES)]
    endless = {"name": "a", "amplitude_um": 1, "polygon_mm": [[0, 0]] * 10_000}
    thick = {"points": [[0.01 * n, 1.5] for n in range(MAX_ENVELOPE_POINTS)]}
    envelopes = [{"name": f"{n:032}", "envelope": thick} for n in range(4)]
    long = {"name": "a", "envelope": {"points": [[n, 0] for n in range(10_000)]}}
    return {
        "envelopes": packed({"client": "a", "effects": envelopes}),
        "an envelope of 10000 points": packed({"client": "a", "effects": [long]}),
        "longest": packed({"client": "a", "virtuals": paths, "targets": targets}),
        "polygons": packed({"client": "a", "surfaces": polygons}),
        "a polygon of 10000 points": packed({"client": "a", "surfaces": [endless]}),
        "brackets": b"\x91" * MAX_MESSAGE_BYTES,
        "maps": b"\x81\xa1v" * (MAX_MESSAGE_BYTES // 3),
        "wide": b"\xdc\x00\x40" + b"\xdc\x00\x40" * 63 + b"\xc0" * (MAX_MESSAGE_BYTES - 192),
        "too long": bytes(MAX_MESSAGE_BYTES + 1),
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

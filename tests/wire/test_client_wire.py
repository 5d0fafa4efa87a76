"""Whatever bytes a client sends, the daemon either understands all of them or refuses with one sentence."""

from __future__ import annotations

import math
import re
from typing import Any

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import asdict, replace

from hapticd.errors import RequestError
from hapticd.wire import client
from hapticd_contract import base, requests, surfaces, targets
from hapticd_contract.base import MAX_MESSAGE_BYTES
from hapticd_contract.contents import CONTENTS, Amplitude, Friction, Gradient, Grating, LevelMap, Noise
from hapticd_contract.effects import (
    At,
    Effect,
    Envelope,
    Modulation,
    Now,
    OnLeaving,
    OnLifting,
    OnPressure,
    Pulse,
)
from hapticd_contract.requests import AssetPart, MarkerRequest, ReachQuery, Release
from hapticd_contract.states import FingerState, PlateState
from hapticd_contract.surfaces import Circle, Polygon, Rectangle, Surface, VirtualPath
from hapticd_contract.targets import ClientTargets, TargetsMessage

FULL: dict[str, Any] = {
    "v": 1,
    "client": "study-7",
    "ttl_s": 0.25,
    "targets": [
        {"finger": 3, "amplitude_um": 1.5},
        {"finger": 4, "friction": 1, "priority": 0},
        {
            "finger": "ghost",
            "grating": {"period_mm": 5, "angle_rad": 0.5, "low_um": 0.1, "high_um": 2.0, "duty_frac": 0.25},
            "priority": 3,
        },
        {"finger": 6, "map": {"width": 2, "height": 3, "levels": b"\x00\x10\x20\x30\x40\xff", "high_um": 3.0}},
    ],
    "virtuals": [
        {"name": "ghost", "path_mm": [[-40, 20], [40.5, 20]], "speed_mm_s": 80, "loop": False},
        {"name": "post", "path_mm": [[0, 0]]},
    ],
    "surfaces": [
        {"name": "all", "friction": 1},
        {
            "name": "patch",
            "amplitude_um": 1.5,
            "polygon_mm": [[0, 0], [9, 0], [0, 5.5]],
            "position_mm": [3, -4],
            "angle_rad": 0.5,
            "scale": 2,
            "velocity_mm_s": [300, -20],
            "turning_rad_s": -1,
            "t_pose_ns": 10**12,
            "z": -3,
            "blend": "max",
        },
    ],
    "effects": [
        {"name": "click", "pulse": {"height_um": 1, "length_s": 0.01}},
        {
            "name": "bump",
            "envelope": {"points": [[0, 1], [0.5, 2], [0.5, 0]], "is_factor": True},
            "surface": "patch",
            "start": {"cause": "pressure", "threshold": 0.5, "release": 0.25},
        },
        {
            "name": "buzz",
            "modulation": {"frequency_hz": 250, "depth": 0.5, "shape": "square", "length_s": 2},
            "finger": 4,
            "start": {"cause": "entering", "surface": "all"},
            "loops": True,
        },
        {"name": "hum", "modulation": {"frequency_hz": 1, "depth": 1}, "start": {"cause": "at", "t_ns": 10**15}},
    ],
}


CLICK = {"height_um": 1, "length_s": 0.01}
HUM: dict[str, Any] = {"frequency_hz": 9, "depth": 1}


def packed(**changes: object) -> bytes:
    return bytes(msgpack.packb({**FULL, **changes}))


def with_target(**target: object) -> bytes:
    return packed(targets=[{"finger": 1, **target}])


def with_map(**fields: object) -> bytes:
    return with_target(map={"width": 1, "height": 1, "levels": b"a", **fields})


def with_surface(**surface: object) -> bytes:
    return packed(surfaces=[{"name": "one", **surface}], effects=[])


def with_effect(**effect: object) -> bytes:
    form = {} if any(name in effect for name in ("pulse", "envelope", "modulation")) else {"pulse": CLICK}
    return packed(effects=[{"name": "one", **form, **effect}])


def with_start(**start: object) -> bytes:
    return with_effect(start=start)


def with_envelope(*points: object, **fields: object) -> bytes:
    return with_effect(envelope={"points": points, **fields})


def sent(**parts: Any) -> TargetsMessage:
    return TargetsMessage(**asdict(ClientTargets.of(**parts)), v=1)


def refusal(payload: bytes) -> str:
    with pytest.raises(RequestError) as caught:
        client.decode_targets(payload)
    return str(caught.value)


# --- what is understood -----------------------------------------------------------------------------------------


def test_the_smallest_message_has_no_targets_and_the_default_time_to_live() -> None:
    payload = bytes(msgpack.packb({"v": 1, "client": "c"}))
    assert client.decode_targets(payload) == sent(client="c", ttl_ns=500_000_000)


@pytest.mark.parametrize(
    "payload",
    [
        with_target(amplitude_um=0),
        with_target(amplitude_um=base.MAX_AMPLITUDE_UM),
        with_target(friction=0.0),
        with_target(friction=0.5, priority=0),
        with_target(friction=0.5, priority=targets.MAX_PRIORITY),
        packed(ttl_s=targets.MIN_TTL_S),
        packed(ttl_s=targets.MAX_TTL_S),
        packed(client="é" * 32),
        packed(targets=[{"finger": n + 1, "friction": 0.5} for n in range(targets.MAX_TARGETS)]),
        packed(targets=[], virtuals=[{"name": str(n), "path_mm": [[0, 0]]} for n in range(targets.MAX_VIRTUALS)]),
        packed(
            targets=[],
            virtuals=[{"name": "a", "path_mm": [[-1000.0, 1000.0], [1, 2]] * (surfaces.MAX_PATH_POINTS // 2)}],
        ),
        with_map(width=128, height=128, levels=bytes(128 * 128), high_um=1),
        with_target(map={"width": 1024, "height": 1024, "asset": bytes(32), "high_um": 1}),
        with_map(friction=[0, 1]),
        with_target(gradient={"length_mm": 0.1, "from_um": 0, "to_um": base.MAX_AMPLITUDE_UM}),
        with_target(noise={"shortest_mm": 0.1, "longest_mm": 0.1, "mean_um": 0, "rms_um": 0, "seed": 2**32 - 1}),
        with_surface(friction=1, path_mm=[[1, 2]], speed_mm_s=0),
    ],
)
def test_a_value_on_its_bound_is_allowed(payload: bytes) -> None:
    client.decode_targets(payload)


def test_values_become_the_message_that_means_the_same() -> None:
    message = ClientTargets.of(
        "scenario",
        500_000_000,
        {
            1: Amplitude(1.5),
            2: Friction(0.25),
            3: Grating(6.0, angle_rad=-0.3, low_um=0.1, high_um=1.9, duty_frac=0.5),
            4: LevelMap(2, 1, b"\0\xff", 0.0, 2.0),
            "walker": Amplitude(0.0),
        },
        {"walker": VirtualPath(((1.0, math.pi), (-3.25, 0.1)), 77.7, loop=False)},
        stamp=2**63 - 1,
        surfaces={
            "plate": Surface.of(Friction(0.5)),
            "tile": Surface.of(Friction(0.5), Rectangle(3.0, 4.0)),
            "disc": Surface.of(Amplitude(1.0), Circle(7.5), z=-2, blend="add"),
            "bow": Surface.of(
                LevelMap(2, 1, b"\0\xff", 0.0, 2.0),
                Polygon(((0.0, 0.0), (9.0, 0.25), (0.0, 5.0))),
                (1.0, -2.5),
                angle_rad=0.3,
                scale=2.0,
                velocity_mm_s=(100.0, -3.0),
                turning_rad_s=-1.5,
                t_pose_ns=10**15,
            ),
            "walk": Surface.of(
                Gradient(5.0, angle_rad=0.5, from_um=0.25, to_um=1.5),
                path=VirtualPath(((1.0, 2.0), (3.0, 4.0)), 40.0, loop=True),
            ),
            "rough": Surface.of(Noise(seed=3, shortest_mm=1.0, longest_mm=8.0, exponent=0.5, mean_um=1.0, rms_um=0.25)),
            "photo": Surface.of(LevelMap(1024, 1024, b"", 0.0, 2.0, asset=bytes(range(32)))),
            "felt": Surface.of(LevelMap(1, 1, b"a", friction=(0.75, 0.25))),
        },
        effects={
            "click": Effect.of(Pulse(-1.0, 0.01, 0.001), start=Now(id=2**63 - 1)),
            "bump": Effect.of(Envelope(((0.0, 0.1), (1.0, 2.0)), is_factor=True), "disc", At(t_ns=10**15)),
            "hum": Effect.of(Modulation(33.3, 0.5, "square"), 3, OnLeaving(surface="bow"), loops=True),
            "buzz": Effect.of(Modulation(250.0, 1.0, length_s=1.0), start=OnLifting()),
            "button": Effect.of(Pulse(1.0, 0.01), start=OnPressure(threshold=0.5, release=0.3)),
        },
        priorities={2: 3, "walker": 1},
    )

    assert asdict(client.decode_targets(client.encode_targets(message))) == {**asdict(message), "v": 1}


@pytest.mark.parametrize(
    ("short", "long"),
    [
        (b"\xa6client", b"\xd9\x06client"),
        (b"\xc4\x06\x00\x10", b"\xc5\x00\x06\x00\x10"),
        (b"\xcb?\xd0" + bytes(6), b"\xca>\x80" + bytes(2)),
    ],
)
def test_a_message_that_is_packed_in_another_way_is_the_same(short: bytes, long: bytes) -> None:
    assert short in packed()
    assert client.decode_targets(packed().replace(short, long, 1)) == client.decode_targets(packed())


# --- what is refused --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        (packed(v=2), "The message has protocol version 2, the daemon has 1: update the daemon."),
        (packed(v=0), "update the client"),
        (packed(client=""), "client: must have 1 .. 32 printable characters."),
        (packed(ttl_s=0.019), "ttl_s: 0.019 is out of bounds, it must be 0.02 .. 5."),
        (packed(ttl_s=True), "ttl_s: must be a number, not a truth value."),
        (packed(ttl_ms=3), "ttl_ms: unknown field"),
        (
            with_map(width=129, levels=bytes(129), high_um=1),
            "targets[0].map: has 129 x 1 pixels, at most 128 x 128 without an asset.",
        ),
        (
            with_map(friction=[0, 1], high_um=1),
            "targets[0].map.friction: a map of frictions has no low_um and no high_um.",
        ),
        (
            with_target(noise={"shortest_mm": 2, "longest_mm": 1, "mean_um": 1, "rms_um": 1}),
            "targets[0].noise.longest_mm: 1 is out of bounds, it must be 2 .. 1000.",
        ),
        (
            with_surface(friction=1, path_mm=[[0, 0]], velocity_mm_s=[1, 0]),
            "surfaces[0].velocity_mm_s: a surface with a path_mm has none.",
        ),
        (packed(targets=[{"finger": n + 1, "friction": 0.5} for n in range(17)]), "targets: has 17 items, at most 16"),
        (packed(targets=[{"finger": 1, "friction": 0.5}] * 2), "targets[1].finger: 1 is listed twice."),
        (packed(targets=[{"friction": 0.5}]), "targets[0].finger: is missing."),
        (with_target(finger=0, friction=0.5), "targets[0].finger: 0 is out of bounds"),
        (with_target(finger=1.5, friction=0.5), "targets[0].finger: must be a whole number or a text, not 1.5."),
        (with_target(friction=0.5, priority=4), "targets[0].priority: 4 is out of bounds, it must be 0 .. 3."),
        (with_target(finger="phantom", friction=0.5), "this message defines no virtual finger 'phantom'"),
        (with_target(), f"targets[0]: needs exactly one of {', '.join(CONTENTS)}."),
        (with_map(asset=bytes(32), high_um=1), "targets[0].map.levels: a map with an asset has none."),
        (with_map(), "targets[0].map.high_um: is missing."),
        (with_target(friction=0.5, fiction=1), "targets[0].fiction: unknown field"),
        (with_target(amplitude_um=math.nan), "targets[0].amplitude_um: nan is out of bounds"),
        (with_map(levels="x", high_um=1), "levels: must be bytes (base64 in JSON), not a text."),
        (packed(virtuals=[{"name": "a", "path_mm": [[0, 0]] * 65}]), "path_mm: has 65 items, at most 64 are allowed."),
        (packed(virtuals=[{"name": "a", "path_mm": [[0, 1001]]}]), "virtuals[0].path_mm[0][1]: 1001 is out of bounds"),
        (packed(surfaces=[{"name": "a", "friction": 1}] * 2), "surfaces[1].name: 'a' is listed twice."),
        (with_surface(friction=1, circle_mm=5, rectangle_mm=[1, 1]), "surfaces[0]: has at most one of circle_mm, "),
        (with_surface(friction=1, polygon_mm=[[0, 0], [9, 9], [9, 0], [0, 9]]), "encloses less than 0.01 mm^2."),
        (with_surface(friction=1, blend="multiply"), "surfaces[0].blend: must be one of add, max, replace."),
        (with_effect(pulse=CLICK, modulation=HUM), "effects[0]: needs exactly one of pulse, envelope, modulation."),
        (with_effect(pulse=CLICK | {"rise_s": 0.006}), "pulse.rise_s: 0.006 is out of bounds, it must be 0 .. 0.005."),
        (with_envelope([0, 1], [0, 2]), "envelope.points: must begin at 0 s and last 0.001 s or more."),
        (with_envelope([0, 1], [1, 2], [0.9, 1]), "envelope.points[2]: is earlier than the point before it."),
        (
            with_envelope([0, 1], [1, -1], is_factor=True),
            "envelope.points[1]: -1 is out of bounds, it must be 0 .. 10.",
        ),
        (with_effect(**{"x" * 200: 1}), f"effects[0].{'x' * 32}: unknown field"),
        (with_map(width=128, height=128, levels=bytes(20000), high_um=1), "has 20000 bytes, it must have 16384."),
        (
            packed(effects=[{"name": f"{n}", "envelope": {"points": [[0, 1]] * 205 + [[1, 1]]}} for n in range(5)]),
            "effects[4].envelope: more than 1024 points in one message.",
        ),
        (with_effect(finger=1, surface="all"), "effects[0]: is on a finger or on a surface, not on both."),
        (with_effect(surface="none"), "effects[0].surface: this message defines no surface 'none'."),
        (with_start(cause="sneezing"), "start.cause: must be one of now, at, landing, lifting, entering, "),
        (with_start(cause="at"), "effects[0].start.t_ns: is missing."),
        (with_start(cause="landing", t_ns=1), "effects[0].start.t_ns: unknown field"),
        (
            with_start(cause="pressure", threshold=0.5, release=0.5),
            "effects[0].start.release: must be below the threshold.",
        ),
        (with_effect(start={"cause": "lifting"}, loops=True), "an effect that starts by lifting needs a length."),
        (
            with_effect(modulation=HUM, start={"cause": "crossing", "surface": "all"}),
            "effects[0]: would never end: an effect that starts by crossing needs a length.",
        ),
    ],
)
def test_a_refusal_names_field_and_defect(payload: bytes, sentence: str) -> None:
    assert sentence in refusal(payload)


def test_a_sound_message_with_a_key_twice_is_refused() -> None:
    twice = b"\x83" + msgpack.packb("v") + b"\x01" + 2 * (msgpack.packb("client") + b"\xa1c")
    assert "the same key twice" in refusal(twice)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x81\x01\x01",
        b"\x81\xc4\x01v\x01",
        b"\x82\xa1v\x01\xa1v\x01",
        b"\xdd\xff\xff\xff\xff",
        b"\xc9\xff\xff\xff\xff\x05",
        b"\xc7\x00\x05",
        b"\x91" * 60_000,
        b"\x81\xa1v" * 20_000,
        packed() + b"\x00",
        packed()[:-1],
        bytes(MAX_MESSAGE_BYTES + 1),
        packed(client=msgpack.ExtType(5, b"x")),
        packed(ttl_s=msgpack.Timestamp(0, 0)),
        packed(client=b"\xff"),
        packed(ttl_s=2**64 - 1),
        packed(targets=[[[[[]]]]]),
    ],
)
def test_hostile_bytes_end_in_one_short_printable_sentence(payload: bytes) -> None:
    sentence = refusal(payload)
    assert sentence.endswith(".")
    assert sentence.isprintable()
    assert len(sentence) < 250


def spoilt(value: object, bad: float) -> list[object]:
    """The value with each of its numbers replaced in turn."""
    if isinstance(value, dict):
        return [{**value, key: other} for key in value for other in spoilt(value[key], bad)]
    if isinstance(value, list):
        return [[*value[:i], other, *value[i + 1 :]] for i in range(len(value)) for other in spoilt(value[i], bad)]
    return [bad] if isinstance(value, int | float) and not isinstance(value, bool) else []


def grown(value: object) -> list[object]:
    """The value with one more field in each of its maps in turn."""
    if isinstance(value, list):
        return [[*value[:i], other, *value[i + 1 :]] for i in range(len(value)) for other in grown(value[i])]
    if not isinstance(value, dict):
        return []
    return [{**value, "hue": 1}, *({**value, key: other} for key in value for other in grown(value[key]))]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300, -1e300])
def test_no_field_takes_a_number_that_is_not_finite_or_beyond_all_bounds(bad: float) -> None:
    messages = spoilt(FULL, bad)
    assert len(messages) > 15
    for message in messages:
        refusal(bytes(msgpack.packb(message)))


def test_no_map_takes_an_unknown_field() -> None:
    messages = grown(FULL)
    assert len(messages) > 15
    for message in messages:
        assert ".hue: unknown field" in "." + refusal(bytes(msgpack.packb(message)))


plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=9)
    | st.binary(max_size=9),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)


@given(st.sampled_from([*FULL, "other"]), plain)
def test_any_value_in_any_field_is_refused_or_read(name: str, value: object) -> None:
    try:
        payload = packed(**{name: value})
    except UnicodeEncodeError:  # a lone surrogate cannot be sent
        return
    try:
        message = client.decode_targets(payload)
    except RequestError as error:
        if "protocol version" in str(error):
            return  # a sentence of its own, before the fields are read
        with pytest.raises(RequestError, match=re.escape(str(error))):
            client.read(client.unpack(payload), TargetsMessage)
    else:
        assert client.read(client.unpack(payload), TargetsMessage) == message


# --- requests and replies ---------------------------------------------------------------------------------------


def request(op: str, request_id: object = 7, **fields: object) -> bytes:
    return bytes(msgpack.packb({"v": 1, "id": request_id, "op": op, **fields}))


def op_of(got: requests.Request) -> object:
    return type(got).__struct_config__.tag


def replied(payload: bytes) -> dict[str, Any]:
    return msgpack.unpackb(client.answer(payload, lambda got: {"op": op_of(got), "nested": {"a": [1, 2.5]}}))


@pytest.mark.parametrize(
    ("op", "body", "read"),
    [
        ("set", {name: value for name, value in FULL.items() if name != "v"}, None),
        ("release", {"client": "a", "finger": 3}, Release("a", 3)),
        ("release", {"client": "a"}, Release("a")),
        ("marker", {"client": "a", "text": "trial 1: begins"}, MarkerRequest("a", "trial 1: begins")),
        ("marker", {"client": "a", "text": "\U0001d11e" * 100}, MarkerRequest("a", "\U0001d11e" * 100)),
        (
            "marker",
            {"client": "a", "text": "t", "fields": {"trial": 7, "is_new": True, "level_um": 1.5, "answer": "low"}},
            MarkerRequest("a", "t", fields={"trial": 7, "is_new": True, "level_um": 1.5, "answer": "low"}),
        ),
        ("reach", {"finger": 3}, ReachQuery(3)),
        ("reach", {"finger": "post"}, ReachQuery("post")),
        ("reach", {"x_mm": 10.0, "y_mm": -4}, ReachQuery(None, 10.0, -4.0)),
        *[
            (op, {}, requests.Nothing())
            for op in ("hello", "capabilities", "status", "plate", "clear_fault", "surfaces")
        ],
    ],
)
def test_each_request_is_read_with_its_body(op: str, body: dict[str, Any], read: object) -> None:
    got = client.decode_request(request(op, body=body))
    assert (op_of(got), got.id) == (op, 7)
    assert op == "set" or got.body == read
    if op == "set":
        assert asdict(got.body) | {"v": 1} == asdict(client.decode_targets(packed()))


def test_an_answer_carries_what_the_handler_returned() -> None:
    body = {"op": "status", "nested": {"a": [1, 2.5]}}
    assert replied(request("status")) == {"v": 1, "id": 7, "ok": True, "body": body}


@pytest.mark.parametrize(
    ("payload", "request_id", "sentence"),
    [
        (b"\xc1", 0, "not valid MessagePack"),
        (msgpack.packb({"v": 1, "op": "status"}), 0, "id: is missing"),
        (request("status", 0), 0, "id: 0 is out of bounds"),
        (request("status", v=2), 7, "update the daemon"),
        (request("explode"), 7, "op: must be one of hello,"),
        (request("set"), 7, "body: is missing."),
        (request("set", body={"client": "a", "targets": [{"finger": 1}]}), 7, "body.targets[0]: needs exactly one"),
        (request("hello", extra=1), 7, "extra: unknown field"),
        (request("reach", body={}), 7, "x_mm: is missing"),
        (request("reach", body={"x_mm": 1e4, "y_mm": 0.0}), 7, "x_mm: 10000"),
        (request("reach", body={"finger": 3, "y_mm": 0.0}), 7, "finger: a query has a finger or a place, not both."),
    ],
)
def test_a_refused_request_is_answered_with_its_id_wherever_it_could_be_read(
    payload: bytes, request_id: int, sentence: str
) -> None:
    reply = msgpack.unpackb(client.answer(payload, lambda _: pytest.fail("a refused request was handled")))
    assert (reply["v"], reply["id"], reply["ok"]) == (1, request_id, False)
    assert sentence in reply["error"]


PART = {"client": "a", "asset": bytes(32), "size": 2**20}
NO_MARKER = "body.text: must have 1 .. 100 printable characters"


def test_a_part_of_an_asset_is_read_with_its_place_and_one_without_bytes_only_asks() -> None:
    read = client.decode_request(request("asset", body={**PART, "offset": 5, "part": b"abc"})).body
    assert read == AssetPart("a", bytes(32), 2**20, 5, b"abc")
    assert client.decode_request(request("asset", body=PART)).body == AssetPart("a", bytes(32), 2**20)


@pytest.mark.parametrize(
    ("op", "body", "sentence"),
    [
        ("asset", PART | {"asset": bytes(31)}, "body.asset: has 31 bytes, it must have 32."),
        ("asset", PART | {"size": 0}, "body.size: 0 is out of bounds, it must be 1 .. 1048576."),
        (
            "asset",
            PART | {"offset": 2**20, "part": b"a"},
            "body.offset: 1048576 is out of bounds, it must be 0 .. 1048575.",
        ),
        ("asset", PART | {"offset": 0, "part": b""}, "body.part: has 0 bytes, it must have 1 .. 16384."),
        ("asset", PART | {"size": 3, "offset": 2, "part": b"ab"}, "body.part: ends at byte 4, the asset has 3."),
        ("asset", PART | {"offset": 0}, "body.offset: without a part there is none."),
        ("asset", PART | {"part": b"a"}, "body.offset: is missing."),
        ("reach", {"client": "a"}, "body.client: unknown field"),
        ("marker", {"text": ""}, NO_MARKER),
        ("marker", {"text": "a" * 101}, NO_MARKER),
        ("marker", {"text": "\U0001d11e" * 101}, NO_MARKER),
        ("marker", {"text": "two\nlines"}, NO_MARKER),
        ("marker", {"text": "t", "fields": {"a": "two\nlines"}}, "body.fields: must have printable texts and finite"),
        ("marker", {"text": "t", "fields": {"a": math.inf}}, "body.fields: must have printable texts and finite"),
        ("marker", {"text": "t", "fields": {"a": [1]}}, "body.fields.a: must be"),
        ("marker", {"text": "t", "fields": {str(n): n for n in range(17)}}, "body.fields: has 17 entries, at most 16"),
    ],
)
def test_a_field_of_a_body_is_refused_by_its_name(op: str, body: dict[str, object], sentence: str) -> None:
    with pytest.raises(RequestError, match=re.escape(sentence)):
        client.decode_request(request(op, body={"client": "a", **body}))


# --- telemetry --------------------------------------------------------------------------------------------------


def test_a_state_is_sent_with_all_its_fields_and_only_finite_numbers() -> None:
    ghost = FingerState("ghost", 1.0, 2.0, 1.5, 2.5, None, math.nan, True, bias_jnd=math.nan)
    state = PlateState(9, 12, 2**40, "ACTIVE", (ghost,), (1.0,), True, 10.5, 16.0, measured_d_q_um=((math.nan, 2.0),))
    sent = msgpack.unpackb(client.encode_state(state))
    assert b"fingers" in client.encode_state(replace(state, fingers=(), measured_d_q_um=()))
    (finger,) = sent["fingers"]
    assert {*finger} == {*FingerState.__struct_fields__}
    assert (finger["achieved_um"], finger["bias_jnd"], sent["measured_um"]) == (None, None, [[None, 2.0]])
    assert (sent["t_ns"], sent["modal_um"], sent["limited"]) == (2**40, [1.0], True)


# --- stamps ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stamp", [0, 1, 2**63 - 1])
def test_a_stamp_is_read_from_every_message_that_changes_something(stamp: int) -> None:
    assert client.decode_targets(packed(stamp=stamp)).stamp == stamp
    for op in ("set", "release"):
        assert client.decode_request(request(op, body={"client": "c", "stamp": stamp})).body.stamp == stamp


@pytest.mark.parametrize("stamp", [-1, 2**63, 1.0, math.nan, "1", True])
def test_what_cannot_be_a_stamp_is_refused_by_name(stamp: object) -> None:
    assert refusal(packed(stamp=stamp)).startswith("stamp: ")


# --- what an outsider tried --------------------------------------------------------------------------------------


@pytest.mark.parametrize("op", ["hello", "capabilities", "status", "plate", "clear_fault"])
def test_a_request_without_fields_may_have_an_empty_body(op: str) -> None:
    assert replied(request(op, body={})) == replied(request(op))
    assert replied(request(op))["body"]["op"] == op
    refused = replied(request(op, body={"client": "a"}))
    assert refused["error"] == "body.client: unknown field, see clients/PROTOCOL.md."
    assert replied(request(op, body=7))["error"] == "body: must be a map, not a whole number."


@pytest.mark.parametrize("body", ["x" * 10_000, {"client": "x" * 200}, [0] * 200, b"x" * 60_000])
def test_the_refusal_of_a_field_that_is_too_long_has_the_request_s_id(body: object) -> None:
    first = replied(request("set", 77, body=body))
    last = replied(msgpack.packb({"v": 1, "op": "set", "body": body, "id": 77}))
    assert [(reply["id"], reply["ok"]) for reply in (first, last)] == [(77, False)] * 2


@pytest.mark.parametrize("request_id", [-1, 2**32, 1.0, "7", None])
def test_the_refusal_of_an_id_that_is_none_has_the_id_0(request_id: object) -> None:
    assert replied(request("hello", request_id))["id"] == 0

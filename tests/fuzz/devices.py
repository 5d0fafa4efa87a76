"""Bytes from devices: any of them give sound frames and messages or none, and nothing grows."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator

import pythonosc.osc_message  # noqa: F401 - read where it is followed: hapticd imports it at the first datagram
from datagrams import tuio1, tuio2

from fuzz.target import CORPORA, Cost, Target
from hapticd.values import Contact, TouchFrame
from hapticd.wire.trackpad import MAX_RECORDS, PADS, Decoder, Pad, PadGeometry, evdev, tuio

MODELS = tuple(PADS)
MODEL_OF_TAG = {"mt2-bt": "mt2-bt", "mt2-usb": "mt2-usb", "mt1-bt": "mt1"}
SCREEN = Pad("evdev", "screen", "evdev", PadGeometry(0, 4000, -4000, 0, 400.0, 200.0, 255, 90), 8_333_333, "evdev")
SURFACE = tuio.surface(400.0, 200.0)
FARTHEST_MM = 2.5 * math.hypot(400.0, 200.0)  # from the surface's centre: a share of its sides is at most 2
LONGEST_NS = 1 << 33  # between a frame's instant and its report's
EVENT_BYTES, KINDS = 8, (0, 1, 3, 4)  # type, code and value of an input event, in the corpus's short form


def contacts_of(frames: Iterable[TouchFrame], most: int, t_host_ns: int | None = None) -> Iterator[Contact]:
    """The contacts of frames, each with an id of its own, and with numbers."""
    for frame in frames:
        assert len({one.contact_id for one in frame.contacts}) == len(frame.contacts) <= most
        assert t_host_ns is None or abs(frame.t_ns - t_host_ns) <= LONGEST_NS
        for contact in frame.contacts:
            assert all(math.isfinite(value) for value in contact)
            assert 0 <= contact.angle_rad < math.pi
            assert 0 <= contact.pressure_frac <= 1
            yield contact


def check_trackpad(data: bytes) -> bool:
    """A byte for the model, then for each report its length, the ms since the last one (signed), and its bytes."""
    decoder = Decoder(MODELS[data[0] % len(MODELS)] if data else MODELS[0])
    t_host_ns, at, reports, frames = 0, 1, 0, 0
    while at < len(data):
        n = data[at]
        t_host_ns += int.from_bytes(data[at + 1 : at + 4], "little", signed=True) * 1_000_000
        given = decoder.decode(data[at + 4 : at + 4 + n], t_host_ns)
        at, reports, frames = at + 4 + n, reports + 1, frames + len(given)
        assert len(given) <= 2
        for contact in contacts_of(given, MAX_RECORDS + 16):  # a Magic Trackpad 1 keeps what it does not mention
            assert math.hypot(contact.x_mm, contact.y_mm) < 200
            assert 0 <= contact.minor_mm < 30
            assert 0 <= contact.major_mm < 30
            assert 0 <= contact.contact_id <= 15
    counters = decoder.counters
    assert counters["frames"] == frames
    refused = sum(counters[reason] for reason in ("foreign", "length", "duplicate_id", "mouse"))
    assert reports - refused <= frames <= 2 * (reports - refused)
    return frames > 0


def trackpad_seeds() -> dict[str, bytes]:
    """Of each layout the reports of the golden file, three at a time."""
    by_model: dict[str, list[bytes]] = {}
    for row in map(json.loads, (CORPORA / "trackpad-golden.jsonl").read_text(encoding="utf-8").splitlines()):
        if "report" in row:
            by_model.setdefault(MODEL_OF_TAG[row["tag"]], []).append(bytes.fromhex(row["report"]))
    head = (11).to_bytes(3, "little")
    return {
        f"{model}-{place}": bytes((MODELS.index(model),))
        + b"".join(bytes((len(report),)) + head + report for report in reports[place : place + 3])
        for model, reports in by_model.items()
        for place in (0, 9, 18)
    }


def check_touchscreen(data: bytes) -> bool:
    """A first byte below 128: events of eight bytes each, a report per 16; else reports as they are, each after its
    length."""
    decoder, found = Decoder(SCREEN), False
    for number, report in enumerate(_short(data[1:]) if data[:1] < b"\x80" else _raw(data[1:])):
        frames = decoder.decode(report, number * 8_000_000)
        for contact in contacts_of(frames, evdev.MAX_CONTACTS, number * 8_000_000):
            assert 0 <= contact.minor_mm <= contact.major_mm * 2.1  # of a screen with two scales
        found = found or bool(frames)
    return found


def _short(data: bytes) -> list[bytes]:
    events = [data[at : at + EVENT_BYTES] for at in range(0, len(data) - EVENT_BYTES + 1, EVENT_BYTES)]
    packed = [
        evdev.EVENT.pack(
            *(number // 100, number % 100 * 10_000, KINDS[event[0] % 4], int.from_bytes(event[1:4], "little") & 0x1FF),
            int.from_bytes(event[4:], "little", signed=True),
        )
        for number, event in enumerate(events)
    ]
    return [b"".join(packed[at : at + 16]) for at in range(0, len(packed), 16)]


def _raw(data: bytes) -> list[bytes]:
    reports, at = [], 0
    while at < len(data):
        reports.append(data[at + 1 : at + 1 + data[at]])
        at += 1 + data[at]
    return reports


def check_tracker(data: bytes) -> bool:
    """Datagrams, each after its length in fours of bytes and the time since the last one in 16 ms (signed)."""
    decoder, t_host_ns, at, frames = Decoder(SURFACE), 0, 0, 0
    while at + 1 < len(data):
        n = 4 * data[at]
        t_host_ns += int.from_bytes(data[at + 1 : at + 2], signed=True) * 16_000_000
        given = decoder.decode(data[at + 2 : at + 2 + n], t_host_ns)
        at, frames = at + 2 + n, frames + len(given)
        assert len(given) <= 1
        for contact in contacts_of(given, tuio.MAX_CONTACTS, t_host_ns):
            assert math.hypot(contact.x_mm, contact.y_mm) <= FARTHEST_MM
    assert decoder.counters["frames"] == frames
    assert decoder.counters["contacts"] <= frames * tuio.MAX_CONTACTS
    return frames > 0


def tracker_seeds() -> dict[str, bytes]:
    one, both = {1: (0.25, 0.5)}, {1: (0.25, 0.5), 2: (0.75, 0.5)}
    sent = {
        "1.1": (tuio1(7, one), tuio1(8, both), tuio.REPEAT, tuio1(9, {2: (0.75, 0.5)})),
        "2.0": (tuio2(7, 3800 * 10**9, one), tuio2(8, 3801 * 10**9, both)),
    }
    return {name: b"".join(bytes((len(one) // 4, 1)) + one for one in datagrams) for name, datagrams in sent.items()}


PAD_COSTS = Cost(3000, 100_000), Cost(60, 500)
TARGETS = (
    Target("trackpad", check_trackpad, *PAD_COSTS, trackpad_seeds),
    Target("touchscreen", check_touchscreen, *PAD_COSTS),
    Target("tracker", check_tracker, *PAD_COSTS, tracker_seeds),
)

"""Reports of a trackpad: any bytes give sound frames or none, and are counted."""

from __future__ import annotations

import json
import math

from fuzz.target import CORPORA, Cost, Target
from hapticd.values import TouchFrame
from hapticd.wire.trackpad import MAX_RECORDS, PADS, Decoder

MODELS = tuple(PADS)
MODEL_OF_TAG = {"mt2-bt": "mt2-bt", "mt2-usb": "mt2-usb", "mt1-bt": "mt1"}
MAX_CONTACTS = MAX_RECORDS + 16  # a Magic Trackpad 1 keeps what it does not mention


def check(data: bytes) -> None:
    """A byte for the model, then for each report its length, the ms since the last one (signed), and its bytes."""
    decoder = Decoder(MODELS[data[0] % len(MODELS)] if data else MODELS[0])
    t_host_ns, at, reports, frames = 0, 1, 0, 0
    while at < len(data):
        n = data[at]
        t_host_ns += int.from_bytes(data[at + 1 : at + 4], "little", signed=True) * 1_000_000
        given = decoder.decode(data[at + 4 : at + 4 + n], t_host_ns)
        at, reports, frames = at + 4 + n, reports + 1, frames + len(given)
        assert len(given) <= 2
        for frame in given:
            check_frame(frame)
    counters = decoder.counters
    assert counters["frames"] == frames
    refused = sum(counters[reason] for reason in ("foreign", "length", "duplicate_id", "mouse"))
    assert reports - refused <= frames <= 2 * (reports - refused)


def check_frame(frame: TouchFrame) -> None:
    assert len({contact.contact_id for contact in frame.contacts}) == len(frame.contacts) <= MAX_CONTACTS
    for contact in frame.contacts:
        assert math.hypot(contact.x_mm, contact.y_mm) < 200
        assert 0 <= contact.angle_rad < math.pi
        assert 0 <= contact.pressure_frac <= 1
        assert 0 <= contact.minor_mm < 30
        assert 0 <= contact.major_mm < 30
        assert 0 <= contact.contact_id <= 15


def said(model: str, *reports: bytes) -> bytes:
    head = (11).to_bytes(3, "little")
    return bytes((MODELS.index(model),)) + b"".join(bytes((len(report),)) + head + report for report in reports)


def seeds() -> dict[str, bytes]:
    """Of each layout the reports of the golden file, three at a time."""
    by_model: dict[str, list[bytes]] = {}
    for row in map(json.loads, (CORPORA / "trackpad-golden.jsonl").read_text(encoding="utf-8").splitlines()):
        if "report" in row:
            by_model.setdefault(MODEL_OF_TAG[row["tag"]], []).append(bytes.fromhex(row["report"]))
    found = {
        f"{model}-{place}": said(model, *reports[place : place + 3])
        for model, reports in by_model.items()
        for place in (0, 9, 18)
    }
    single = by_model["mt1"][0]
    found["mt1-pair"] = said("mt1", bytes((0xF7, len(single))) + single + single, single[:4])
    found["mouse"] = said("mt2-usb", bytes((2, 0, 1, 1)), by_model["mt2-usb"][0])
    return found


TARGET = Target(
    name="trackpad",
    check=check,
    seeds=seeds,
    fixed=Cost(3000, 100_000),
    per_byte=Cost(60, 500),
)

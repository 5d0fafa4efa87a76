"""Datagrams of a tracker (TUIO in OSC): any bytes give sound frames or none, and nothing grows."""

from __future__ import annotations

import math

import pythonosc.osc_message  # noqa: F401 - read where it is followed: hapticd imports it at the first datagram
from datagrams import bundle, message, tuio1, tuio2

from fuzz.target import Cost, Target
from hapticd.wire.trackpad import Decoder, tuio

SURFACE = tuio.surface(400.0, 200.0)
FARTHEST_MM = 2.5 * math.hypot(400.0, 200.0)  # from its centre: a share of its sides is at most 2
STEP_NS = 16_000_000  # of the time between datagrams: up to two seconds, also backwards
SECOND_NS = 1_000_000_000


def check(data: bytes) -> None:
    """Datagrams, each after its length in fours of bytes and the time since the last one in steps (signed)."""
    decoder, t_host_ns, at, frames = Decoder(SURFACE), 0, 0, 0
    while at + 1 < len(data):
        n = 4 * data[at]
        t_host_ns += int.from_bytes(data[at + 1 : at + 2], signed=True) * STEP_NS
        given = decoder.decode(data[at + 2 : at + 2 + n], t_host_ns)
        at, frames = at + 2 + n, frames + len(given)
        assert len(given) <= 1
        for frame in given:
            assert len({one.contact_id for one in frame.contacts}) == len(frame.contacts) <= tuio.MAX_CONTACTS
            assert abs(frame.t_ns - t_host_ns) <= 1 << 33
            for contact in frame.contacts:
                assert all(math.isfinite(value) for value in contact)
                assert math.hypot(contact.x_mm, contact.y_mm) <= FARTHEST_MM
                assert 0 <= contact.pressure_frac <= 1
    assert decoder.counters["frames"] == frames
    assert decoder.counters["contacts"] <= frames * tuio.MAX_CONTACTS


def said(*datagrams: bytes) -> bytes:
    return b"".join(bytes((len(datagram) // 4, 1)) + datagram for datagram in datagrams)


def seeds() -> dict[str, bytes]:
    place, other = (0.25, 0.5), (0.75, 0.5)
    return {
        "1.1": said(tuio1(7, {1: place}), tuio1(8, {1: place, 2: other}), tuio.REPEAT, tuio1(9, {2: other})),
        "2.0": said(tuio2(7, 3800 * SECOND_NS, {1: place}), tuio2(8, 3801 * SECOND_NS, {1: place, 2: other})),
        "late": said(tuio1(9, {1: place}), tuio1(8, {2: place}), tuio1(200, {2: place}, "another")),
        "alone": said(
            message("/tuio/2Dcur", "alive", 1.0),
            message("/tuio/2Dcur", "set", 1, *place, kinds="sidd"),
            message("/tuio/2Dcur", "fseq", 3, kinds="sh"),
            message("/tuio/2Dcur", "alive", 1),
            bundle(bundle(message("/tuio/2Dcur", "set", 1.0, *other), message("/tuio/2Dcur", "alive", 1.0))),
        ),
        "profiles": said(
            bundle(message("/tuio/25Dcur", "alive", 1), message("/tuio/25Dcur", "set", 1, *place, 0.5)),
            bundle(message("/tuio/2Dblb", "alive", 1), message("/tuio/2Dblb", "fseq", 1)),
            bundle(
                message("/tuio2/tok", 2, 0, 0, *place), message("/tuio2/bnd", 1, *place), message("/tuio2/alv", 1, 2)
            ),
            message("/tuio2/frm", 9, 2, 3, "tracker"),
        ),
        "not whole": said(message("/tuio/2Dcur", "set", 1, 0.5, 0.5), message("/tuio2/frm", 1, 2, 3, "tracker")),
    }


TARGET = Target(name="tracker", check=check, seeds=seeds, fixed=Cost(3000, 100_000), per_byte=Cost(60, 500))

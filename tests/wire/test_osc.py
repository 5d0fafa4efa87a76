"""OSC messages: their layout in both directions, and a sentence for every datagram that is none."""

from __future__ import annotations

import struct
import sys

import pytest
from datagrams import bundle, text

from hapticd.errors import HapticdError
from hapticd.wire import osc
from hapticd.wire.osc import OscError, OscMessage, decoded, elements, encoded
from hapticd.wire.trackpad import Decoder, tuio


def test_a_message_is_laid_out_as_osc_1_has_it() -> None:
    written = b"/hapticd/friction\0\0\0,if\0\0\0\0\x03\x3e\x80\0\0"
    assert encoded("/hapticd/friction", 3, 0.25) == written
    assert decoded(written) == OscMessage("/hapticd/friction", [3, 0.25])
    assert decoded(encoded("/abc", "text", -1, "")) == OscMessage("/abc", ["text", -1, ""])


def test_a_bundle_is_its_messages_also_of_nested_ones() -> None:
    one, other = encoded("/a", 1), encoded("/b", "x")
    assert elements(bundle(one, other)) == elements(bundle(bundle(bundle(one), bundle()), other)) == [one, other]
    assert elements(one) == [one]
    assert elements(bundle()) == elements(bundle(bundle())) == []


def test_without_the_package_a_tracker_is_refused_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pythonosc", None)
    with pytest.raises(HapticdError, match="python-osc"):
        Decoder(tuio.surface(400.0, 200.0))


@pytest.mark.parametrize(
    ("datagram", "reason", "sentence"),
    [
        (b"", "foreign", "is no OSC message"),
        (b"/a", "foreign", "is no OSC message"),
        (b"/" * 2000 + b"\0", "foreign", "is no OSC message"),
        (text("a") + text(","), "foreign", "is no OSC message"),
        (b"/a\0\0i\0\0\0", "foreign", "is no OSC message"),
        (b"/\0,\0,bbb\0\0\0\0", "foreign", "is no OSC message"),  # types where the package reads none
        (text("/a") + text("," + "i" * 257) + bytes(1028), "foreign", "at most 256 types"),
        (b"/a\0\0,b\0\0\0\0", "foreign", "is no OSC message"),
        (b"/a\0\0,[\0\0\0\0", "foreign", "is no OSC message"),
        (b"/a\0\0,i\0\0\0\0", "length", "too early for its arguments"),
        (b"/a\0\0,f\0\0", "length", "too early for its arguments"),
        (b"/a\0\0,t\0\0" + bytes(4), "length", "ends within an argument"),
        (b"/a\0\0,s\0\0abcd", "length", "ends within an argument"),
        (b"/a\0\0,s\0\0caf\xe9\0\0\0\0", "length", "is not UTF-8"),
        (osc.BUNDLE, "length", "before its time"),
        (bundle() + b"\0\0", "length", "ends within one"),
        (bundle(*[encoded("/a")] * 129), "length", "more than 128 messages"),
        (bundle() + struct.pack(">I", 1 << 31) + b"/a", "length", "ends within a message"),
        (bundle(bundle()[:-4]), "foreign", "is no OSC message"),
        (b"/a\0\0,h\0\0" + bytes(4), "length", "ends within an argument"),
        (bundle() + struct.pack(">i", -4) + b"/a\0\0", "length", "ends within a message"),
    ],
)
def test_another_datagram_is_refused_in_a_sentence(datagram: bytes, reason: str, sentence: str) -> None:
    with pytest.raises(OscError, match=sentence) as refused:
        [decoded(one) for one in elements(datagram)]
    assert refused.value.reason == reason

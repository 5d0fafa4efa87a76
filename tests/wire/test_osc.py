"""OSC messages: their layout in both directions, and a sentence for every datagram that is none."""

from __future__ import annotations

import random
import struct
from contextlib import suppress

import pytest
from datagrams import bundle, message, text

from hapticd.wire import osc
from hapticd.wire.osc import OscError, OscMessage, decoded, encoded, messages


def test_a_message_is_laid_out_as_osc_1_has_it() -> None:
    written = b"/hapticd/friction\0\0\0,if\0\0\0\0\x03\x3e\x80\0\0"
    assert encoded("/hapticd/friction", 3, 0.25) == written
    assert decoded(written) == OscMessage("/hapticd/friction", [3, 0.25])
    assert decoded(encoded("/abc", "text", -1, "")) == OscMessage("/abc", ["text", -1, ""])


def test_a_bundle_is_its_messages_and_a_message_alone_is_one() -> None:
    one, other = encoded("/a", 1), encoded("/b", "x")
    assert messages(bundle(one, other)) == [OscMessage("/a", [1]), OscMessage("/b", ["x"])]
    assert messages(one) == [OscMessage("/a", [1])]
    assert messages(bundle()) == []


def test_a_time_is_in_ns_and_a_text_that_is_not_utf_8_stays_readable() -> None:
    assert decoded(message("/a", 1_500_000_000, times=(0,))).arguments == [1_500_000_000]
    assert decoded(b"/a\0\0,s\0\0caf\xe9\0\0\0\0").arguments == ["caf\ufffd"]


@pytest.mark.parametrize(
    ("datagram", "reason", "sentence"),
    [
        (b"", "length", "ends within a text"),
        (b"/a", "length", "ends within a text"),
        (b"/a\0\0", "length", "ends within a text"),
        (b"/" * 2000 + b"\0", "length", "ends within a text"),
        (text("a") + text(","), "foreign", "must begin with a slash"),
        (b"/a\0\0i\0\0\0", "foreign", "has no types"),
        (text("/a") + text("," + "i" * 33) + bytes(132), "foreign", "more than 32 arguments"),
        (b"/a\0\0,b\0\0\0\0\0\0", "foreign", "not of type i, f, s or t"),
        (b"/a\0\0,i\0\0\0\0", "length", "ends too early"),
        (b"/a\0\0,t\0\0" + bytes(4), "length", "ends too early"),
        (b"/a\0\0,s\0\0abc", "length", "ends within a text"),
        (osc.BUNDLE, "length", "before its time"),
        (bundle() + b"\0\0", "length", "ends within one"),
        (bundle(*[encoded("/a")] * 129), "length", "more than 128 messages"),
        (bundle() + struct.pack(">I", 1 << 31) + b"/a", "length", "ends within a message"),
        (bundle(bundle()), "foreign", "must begin with a slash"),
    ],
)
def test_another_datagram_is_refused_in_a_sentence(datagram: bytes, reason: str, sentence: str) -> None:
    with pytest.raises(OscError, match=sentence) as refused:
        messages(datagram)
    assert refused.value.reason == reason


def test_no_bytes_raise_anything_else() -> None:
    chance, sound = random.Random(1), bundle(encoded("/hapticd/marker", "text", 3, 0.5), message("/a", 9, times=(0,)))
    for _ in range(20_000):
        changed = bytearray(sound[: chance.randrange(len(sound) + 1)] if chance.random() < 0.3 else sound)
        for _ in range(chance.randrange(4)):
            if changed:
                changed[chance.randrange(len(changed))] = chance.randrange(256)
        with suppress(OscError):
            assert len(messages(bytes(changed))) <= 2

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from hapticd.wire.framing import FrameSplitter, encode_frame

MESSAGES = st.one_of(
    st.binary(min_size=1, max_size=40),
    st.binary(min_size=240, max_size=520),
    st.integers(250, 520).map(lambda n: b"\x07" * n),  # around the length of a full COBS block
)


def test_the_crc_is_ccitt_false() -> None:
    # The check value of the CRC catalogue, 0x29B1 for "123456789"; none of its bytes is zero, so COBS shows it plainly.
    assert encode_frame(b"123456789") == b"\x0c123456789\xb1\x29\x00"


@given(st.lists(MESSAGES, max_size=6))
def test_what_is_framed_comes_out_again(messages: list[bytes]) -> None:
    line = b"".join(map(encode_frame, messages))
    assert line.count(0) == len(messages)
    splitter = FrameSplitter(600)
    assert splitter.feed(line) == messages
    assert not any(splitter.counters.values())


@given(
    st.lists(st.one_of(st.binary(max_size=90), MESSAGES.map(encode_frame)), max_size=6).map(b"".join),
    st.lists(st.integers(0, 1500), max_size=12),
)
def test_pieces_of_any_size_give_the_same_messages(line: bytes, cuts: list[int]) -> None:
    edges = sorted({0, len(line), *(cut for cut in cuts if cut < len(line))})
    whole, piecewise = FrameSplitter(300), FrameSplitter(300)
    pieces = [message for a, b in pairwise(edges) for message in piecewise.feed(line[a:b])]
    assert pieces == whole.feed(line)
    assert piecewise.counters == whole.counters


@given(st.binary(max_size=400))
def test_noise_costs_at_most_the_frame_it_runs_into(noise: bytes) -> None:
    splitter = FrameSplitter(300)
    splitter.feed(noise)
    first, second = b"one\x00message", b"another"
    assert splitter.feed(encode_frame(first) + encode_frame(second))[-1] == second


def test_memory_stays_bounded_without_a_delimiter() -> None:
    splitter = FrameSplitter(64)
    for _ in range(100):
        splitter.feed(b"\x01" * 1000)
    assert len(splitter._rest) <= 64 + 1
    splitter.feed(b"\0")
    assert splitter.counters == {"oversize": 1, "cobs": 0, "crc": 0}
    assert splitter.feed(encode_frame(b"back")) == [b"back"]


def test_runs_around_a_full_block_come_out_again() -> None:
    for n in (*range(248, 258), *range(502, 512)):
        for message in (b"\x07" * n, b"\x07" * n + b"\0" + b"\x07" * n):
            assert FrameSplitter(1200).feed(encode_frame(message)) == [message]

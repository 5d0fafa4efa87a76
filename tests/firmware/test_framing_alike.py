"""The firmware's codec and the host's: the same bytes for the same message."""

from __future__ import annotations

import ctypes

from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.sim.board import firmware
from hapticd.wire.framing import FrameSplitter, encode_frame


@settings(max_examples=150)
@given(
    st.integers(1, 255),
    st.one_of(st.binary(max_size=300), st.integers(0, 630).map(lambda n: b"\x2a" * n)),
)
def test_board_and_host_frame_alike(kind: int, payload: bytes) -> None:
    library = firmware.load(2)
    library.hd_frame_encode.restype = ctypes.c_size_t
    out = ctypes.create_string_buffer(800)
    n = library.hd_frame_encode(ctypes.c_uint8(kind), payload, ctypes.c_size_t(len(payload)), out)
    message = bytes((kind,)) + payload
    assert FrameSplitter(800).feed(out.raw[:n]) == [message]
    assert out.raw[:n] == encode_frame(message)

"""The firmware's smallest parts called one by one: the limits on amplitudes and voltages, and the codec."""

from __future__ import annotations

import ctypes
import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hapticd.sim.board import firmware
from hapticd.wire.framing import FrameSplitter, encode_frame

UNTOUCHED, SCALED, NOT_FINITE = range(3)
LIMIT_UM = np.array([4.0, 2.5], dtype=np.float32)
LIMIT_V = 150.0
FLOATS = st.one_of(st.floats(width=32), st.floats(-200, 200, width=32), st.sampled_from([0.0, -0.0, 4.0, 150.0]))
PHASORS = st.lists(FLOATS, min_size=4, max_size=4)
Floats = npt.NDArray[np.float32]


def limited_amplitudes(values: list[float]) -> tuple[int, Floats]:
    """What the amplitude limit makes of (d, q) of two modes."""
    phasors = np.array(values, dtype=np.float32)
    limit = firmware.load(2).hd_limit_amplitudes
    return limit(ctypes.c_void_p(phasors.ctypes.data), ctypes.c_void_p(LIMIT_UM.ctypes.data)), phasors


def limited_voltages(values: list[float]) -> tuple[int, Floats]:
    phasors = np.array(values, dtype=np.float32)
    limit = firmware.load(2).hd_limit_voltages
    return limit(ctypes.c_void_p(phasors.ctypes.data), ctypes.c_float(LIMIT_V)), phasors


def magnitudes(phasors: Floats) -> npt.NDArray[np.float64]:
    return np.hypot(phasors[::2].astype(np.float64), phasors[1::2].astype(np.float64))


def direction(phasors: Floats) -> npt.NDArray[np.float64]:
    return phasors.astype(np.float64) / np.abs(phasors).max()


@settings(max_examples=400)
@given(PHASORS)
@example([4.0, 0.0, 2.5, 0.0])
@example([3.4e38, 3.4e38, 0.0, 0.0])
@example([1e-45, 0.0, math.nan, 0.0])
def test_amplitudes_come_out_within_their_limits_in_the_same_proportion(values: list[float]) -> None:
    result, out = limited_amplitudes(values)
    given_um = np.array(values, dtype=np.float32)
    assert (magnitudes(out) <= LIMIT_UM * (1 + 1.2e-6)).all()
    if not np.isfinite(given_um).all():
        assert result == NOT_FINITE
        assert not out.any()
    elif result == UNTOUCHED:
        np.testing.assert_array_equal(out, given_um)
    else:
        assert (magnitudes(out) <= LIMIT_UM).all()
        assert (magnitudes(given_um) > LIMIT_UM).any()
        if np.abs(given_um).max() < 1e18:  # beyond it the magnitude overflows, and silence is what is left
            np.testing.assert_allclose(direction(out), direction(given_um), rtol=1e-6, atol=1e-6)
            assert (magnitudes(out) / LIMIT_UM).max() > 1 - 2e-6


@pytest.mark.parametrize(("over", "result"), [(0.0, UNTOUCHED), (8e-7, UNTOUCHED), (2e-6, SCALED), (1e-3, SCALED)])
def test_only_float32_rounding_is_tolerated_above_the_limit(over: float, result: int) -> None:
    assert limited_amplitudes([2.4 * (1 + over), 3.2 * (1 + over), 0.0, 0.0])[0] == result


@settings(max_examples=400)
@given(PHASORS)
@example([150.0, 0.0, 0.0, -150.0])
@example([3.4e38, 3.4e38, 1.0, 0.0])
def test_voltages_come_out_within_the_limit_whatever_goes_in(values: list[float]) -> None:
    result, out = limited_voltages(values)
    given_v = np.array(values, dtype=np.float32)
    assert (magnitudes(out) <= LIMIT_V * (1 + 1e-7)).all()
    if not np.isfinite(given_v).all():
        assert result == NOT_FINITE
        assert not out.any()
        return
    for k in range(2):
        mode_in, mode_out = given_v[2 * k : 2 * k + 2], out[2 * k : 2 * k + 2]
        if magnitudes(mode_in)[0] <= LIMIT_V * (1 - 1e-7):
            np.testing.assert_array_equal(mode_out, mode_in)
        elif np.abs(mode_in).max() < 1e18:
            np.testing.assert_allclose(direction(mode_out), direction(mode_in), rtol=1e-6, atol=1e-6)


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

"""A polyline through what is wanted: within the tolerance wherever it was promised, with no more knots than allowed."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.frame import refine
from hapticd.core.phasors import Phasors
from hapticd.core.trajectory.gate import GRAIN_NS, SHORTEST_NS
from hapticd.values import Knot

SPAN_NS = 17_000_000


class Curve:
    """Two modes over time, and how often they were asked for."""

    def __init__(self, *modes: object) -> None:
        self.modes = modes
        self.asked = 0

    def __call__(self, dt_ns: int, _: Knot | None = None) -> Phasors:
        self.asked += 1
        return tuple(mode(dt_ns * 1e-9) for mode in self.modes)

    def ends(self) -> list[Knot]:
        return [Knot(0, self(0)), Knot(SPAN_NS, self(SPAN_NS))]


def error_um(curve: Curve, knots: list[Knot]) -> float:
    t_ns = np.linspace(0, SPAN_NS, 1701)
    exact = np.array([curve(int(t)) for t in t_ns])
    at_ns, values = [knot.dt_ns for knot in knots], np.array([knot.modal_um for knot in knots])
    played = np.stack([np.interp(t_ns, at_ns, column) for column in values.T], axis=1)
    return float(np.abs(played - exact).max())


@given(
    amplitude_um=st.floats(0.0, 4.0),
    frequency_hz=st.floats(0.0, 15.0),
    phase_rad=st.floats(0.0, math.tau),
    tolerance_um=st.floats(0.005, 0.1),
)
def test_smooth_amplitudes_are_followed_within_the_tolerance(
    amplitude_um: float, frequency_hz: float, phase_rad: float, tolerance_um: float
) -> None:
    curve = Curve(
        lambda t_s: amplitude_um * math.sin(math.tau * frequency_hz * t_s + phase_rad),
        lambda t_s: 0.5 * amplitude_um * math.cos(math.tau * frequency_hz * t_s),
    )
    knots = refine(curve, curve.ends(), tolerance_um, 24, 99, smooth=False)
    assert error_um(curve, knots) <= 3.0 * tolerance_um  # next to an inflection a chord strays most off its middle
    assert [knot.modal_um for knot in knots] == [curve(knot.dt_ns) for knot in knots]


def test_a_smooth_curve_costs_fewer_looks_than_one_that_may_have_corners() -> None:
    asked = []
    for promise in (True, False):
        curve = Curve(lambda t_s: 2.0 * math.sin(60.0 * t_s))
        knots = refine(curve, curve.ends(), 0.02, 24, 99, smooth=promise)
        asked.append(curve.asked)
        assert error_um(curve, knots) < 0.03
    assert asked[0] < asked[1]


def test_a_step_is_narrowed_down_to_the_board_s_own_pace() -> None:
    curve = Curve(lambda t_s: 1.0 if t_s > 0.0061 else 0.0)
    knots = refine(curve, curve.ends(), 0.01, 24, 99, smooth=False)
    (edge,) = [i for i in range(len(knots) - 1) if knots[i].modal_um != knots[i + 1].modal_um]
    assert knots[edge].dt_ns <= 6_100_000 < knots[edge + 1].dt_ns
    assert knots[edge + 1].dt_ns - knots[edge].dt_ns < 2 * SHORTEST_NS + GRAIN_NS


@given(most=st.integers(2, 24), seed=st.integers(0, 1000))
def test_knots_are_in_order_on_the_wire_s_grain_and_never_too_many(most: int, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(size=(2, 4096))
    curve = Curve(*(lambda t_s, row=row: float(row[int(t_s * 2e5) % 4096]) for row in noise))
    knots = refine(curve, curve.ends(), 0.001, most, 99, smooth=False)
    assert 2 <= len(knots) <= most
    times_ns = [knot.dt_ns for knot in knots]
    assert times_ns == sorted(set(times_ns))
    assert all(t_ns % GRAIN_NS == 0 for t_ns in times_ns[1:-1])


def test_where_knots_are_short_the_worst_chord_is_mended_first() -> None:
    curve = Curve(lambda t_s: math.exp(-t_s / 0.001))
    knots = refine(curve, curve.ends(), 1e-4, 6, 99, smooth=False)
    assert len(knots) == 6
    assert all(knot.dt_ns < SPAN_NS / 2 + GRAIN_NS for knot in knots[:-1])

"""The gate: what passes is bounded for every float, keeps its pattern, or is silence with its reason."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.core.limits import MAX_SPAN_NS, gate, silence
from hapticd.values import Drive, Knot, LimitReason, SafeDrive

any_float = st.floats() | st.sampled_from(
    [0.0, 4.0, math.nextafter(4.0, 5.0), 5e-324, 1e-310, 1.7e308, math.nan, math.inf, -math.inf]
)
any_complex = st.builds(complex, any_float, any_float)
any_limit = st.sampled_from([4.0, 3.3, 0.1, 0.0, 5e-324, 1e-310]) | st.floats(1e-3, 1e3)


def drive(*modal_um: tuple[complex, ...], t_apply_ns: int = 10**15) -> Drive:
    return Drive(t_apply_ns, tuple(Knot(1000 * index, modal) for index, modal in enumerate(modal_um)))


def toward_zero_float32(value: float) -> float:
    """What the encoder puts on the wire."""
    single = np.float32(value)
    return float(single if abs(float(single)) <= abs(value) else np.nextafter(single, np.float32(0)))


@settings(deadline=None, max_examples=500)
@given(knots=st.lists(st.tuples(any_complex, any_complex, any_complex), min_size=1, max_size=4), data=st.data())
def test_every_float_leaves_the_gate_within_the_limits(knots: list[tuple[complex, ...]], data: st.DataObject) -> None:
    limit_um = data.draw(st.tuples(any_limit, any_limit, any_limit))
    safe = gate(drive(*knots), limit_um)
    for knot in safe.knots:
        for w_um, limit in zip(knot.modal_um, limit_um, strict=True):
            assert math.hypot(w_um.real, w_um.imag) <= limit
            assert math.hypot(toward_zero_float32(w_um.real), toward_zero_float32(w_um.imag)) <= limit
    again = gate(Drive(safe.t_apply_ns, safe.knots), limit_um)
    assert again.knots == safe.knots
    assert again.reasons is LimitReason.NONE


def test_a_drive_within_the_limits_passes_untouched() -> None:
    wanted = drive((4.0 + 0j, 2.4 - 3.2j), (0j, -4j))
    safe = gate(wanted, (4.0, 4.0))
    assert safe == SafeDrive(wanted.t_apply_ns, wanted.knots, LimitReason.NONE)


@settings(deadline=None, max_examples=200)
@given(
    modal_um=st.lists(st.complex_numbers(max_magnitude=1e6, allow_subnormal=False), min_size=2, max_size=4),
    others=st.lists(st.complex_numbers(max_magnitude=3.0), min_size=2, max_size=4),
)
def test_all_modes_of_a_knot_are_scaled_together_and_others_are_not(
    modal_um: list[complex], others: list[complex]
) -> None:
    """One real factor: the pattern's zero under a finger stays where it is."""
    modes = min(len(modal_um), len(others))
    loud, quiet = tuple(modal_um[:modes]), tuple(others[:modes])
    safe = gate(drive(loud, quiet), (4.0,) * modes)
    largest = max(abs(w) for w in loud)
    factor = min(1.0, 4.0 / largest) if largest > 0 else 1.0
    assert safe.knots[1].modal_um == quiet
    for w, wanted in zip(safe.knots[0].modal_um, loud, strict=True):
        assert abs(w - wanted * factor) <= 1e-14 * max(abs(wanted) * factor, 1e-290)
    assert safe.reasons == (LimitReason.AMPLITUDE if largest > 4.0 else LimitReason.NONE)


def test_the_limit_is_reached_not_undercut() -> None:
    (knot,) = gate(drive((30.0 + 40.0j, 10j)), (3.3, 4.0)).knots
    assert math.hypot(knot.modal_um[0].real, knot.modal_um[0].imag) == pytest.approx(3.3, rel=1e-15)


def test_a_mode_with_limit_zero_silences_the_knots_that_use_it() -> None:
    safe = gate(drive((1 + 0j, 1 + 0j), (1 + 0j, 0j)), (4.0, 0.0))
    assert [knot.modal_um for knot in safe.knots] == [(0j, 0j), (1 + 0j, 0j)]


def test_where_no_float_is_small_enough_the_factor_falls_to_zero() -> None:
    """The limit is the smallest float; the other mode keeps the scaling far from it, so rounding must not loop."""
    safe = gate(drive((complex(1e-300, 1e-300), 1 + 0j)), (5e-324, 4.0))
    assert math.hypot(safe.knots[0].modal_um[0].real, safe.knots[0].modal_um[0].imag) <= 5e-324


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("part", ["real", "imaginary"])
def test_what_is_not_finite_silences_the_whole_drive(bad: float, part: str) -> None:
    poisoned = complex(bad, 0.0) if part == "real" else complex(0.0, bad)
    safe = gate(drive((1 + 0j, 1 + 0j), (1 + 0j, poisoned), t_apply_ns=77), (4.0, 4.0))
    assert safe == silence(77, 2, LimitReason.NOT_FINITE)


GOOD = (Knot(0, (1 + 0j, 0j)), Knot(5, (1 + 0j, 0j)))


@pytest.mark.parametrize(
    ("malformed", "limit_um"),
    [
        (Drive(1, ()), (4.0, 4.0)),
        (Drive(1, tuple(Knot(index, (0j, 0j)) for index in range(25))), (4.0, 4.0)),
        (Drive(1, (*GOOD, Knot(5, (0j, 0j)))), (4.0, 4.0)),
        (Drive(1, (*GOOD, Knot(4, (0j, 0j)))), (4.0, 4.0)),
        (Drive(1, (Knot(-1, (0j, 0j)),)), (4.0, 4.0)),
        (Drive(1, (Knot(MAX_SPAN_NS + 1, (0j, 0j)),)), (4.0, 4.0)),
        (Drive(1, (Knot(math.nan, (0j, 0j)),)), (4.0, 4.0)),  # type: ignore[arg-type]
        (Drive(1, (*GOOD, Knot(5.5, (0j, 0j)))), (4.0, 4.0)),  # type: ignore[arg-type]
        (Drive(1, (*GOOD, Knot(6, (0j,)))), (4.0, 4.0)),
        (Drive(1, GOOD), (4.0,)),
        (Drive(1, GOOD), (4.0, 4.0, 4.0)),
        (Drive(1, GOOD), (4.0, math.nan)),
        (Drive(1, GOOD), (4.0, -1.0)),
        (Drive(1, GOOD), (4.0, math.inf)),
        (Drive(1, GOOD), ()),
        (Drive(1, (Knot(0, ()),)), ()),
        (Drive(math.nan, GOOD), (4.0, 4.0)),  # type: ignore[arg-type]
    ],
)
def test_what_is_malformed_is_silence(malformed: Drive, limit_um: tuple[float, ...]) -> None:
    safe = gate(malformed, limit_um)
    t_apply_ns = malformed.t_apply_ns if isinstance(malformed.t_apply_ns, int) else 0
    assert safe == silence(t_apply_ns, max(len(limit_um), 1), LimitReason.MALFORMED)


def test_as_many_knots_as_allowed_and_the_longest_span_pass() -> None:
    knots = (*(Knot(index, (1 + 0j,)) for index in range(3)), Knot(MAX_SPAN_NS, (1 + 0j,)))
    assert gate(Drive(1, knots), (4.0,), max_knots=4).knots == knots
    assert gate(Drive(1, knots), (4.0,), max_knots=3).reasons is LimitReason.MALFORMED


def test_between_knots_the_interpolated_amplitude_stays_within_the_limit() -> None:
    angles = [0.0, 2.0, 4.0, 5.5]
    safe = gate(drive(*[(9 * complex(math.cos(a), math.sin(a)),) for a in angles]), (4.0,))
    for one, two in pairwise(safe.knots):
        for share in (0.1, 0.5, 0.9):
            assert abs(one.modal_um[0] * (1 - share) + two.modal_um[0] * share) <= 4.0


def test_silence_is_one_zero_knot() -> None:
    assert silence(5, 3) == SafeDrive(5, (Knot(0, (0j, 0j, 0j)),), LimitReason.NONE)

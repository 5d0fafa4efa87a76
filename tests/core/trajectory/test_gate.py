"""The gate: what passes is bounded for every float, keeps its pattern, or is silence with its reason."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.core.trajectory.gate import MAX_SPAN_NS, gate, silence
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


@given(knots=st.lists(st.tuples(any_complex, any_complex, any_complex), min_size=1, max_size=4), data=st.data())
def test_every_float_leaves_the_gate_within_the_limits(knots: list[tuple[complex, ...]], data: st.DataObject) -> None:
    limit_um = data.draw(st.tuples(any_limit, any_limit, any_limit))
    safe = gate(drive(*knots), limit_um)
    for knot in safe.knots:
        for w_um, limit in zip(knot.modal_um, limit_um, strict=True):
            assert abs(w_um) <= limit
            assert abs(complex(toward_zero_float32(w_um.real), toward_zero_float32(w_um.imag))) <= limit
    again = gate(Drive(safe.t_apply_ns, safe.knots), limit_um)
    assert again.knots == safe.knots
    assert again.reasons is LimitReason.NONE


def test_a_phasor_longer_than_any_float_is_brought_within_the_limit() -> None:
    ((_, (w_um, other_um)),) = gate(drive((complex(1.7e308, 1.7e308), 0j)), (4.0, 4.0)).knots
    assert math.hypot(w_um.real, w_um.imag) == pytest.approx(4.0)
    assert other_um == 0.0


def test_a_drive_within_the_limits_passes_untouched() -> None:
    wanted = drive((4.0 + 0j, 2.4 - 3.2j), (0j, -4j))
    safe = gate(wanted, (4.0, 4.0))
    assert safe == SafeDrive(wanted.t_apply_ns, wanted.knots, LimitReason.NONE)


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
        (Drive(1, (Knot(math.nan, (0j, 0j)),)), (4.0, 4.0)),
        (Drive(1, (*GOOD, Knot(5.5, (0j, 0j)))), (4.0, 4.0)),
        (Drive(1, (*GOOD, Knot(6, (0j,)))), (4.0, 4.0)),
        (Drive(1, GOOD), (4.0,)),
        (Drive(1, GOOD), (4.0, 4.0, 4.0)),
        (Drive(1, GOOD), (4.0, math.nan)),
        (Drive(1, GOOD), (4.0, -1.0)),
        (Drive(1, GOOD), (4.0, -5e-324)),
        (Drive(1, GOOD), (4.0, math.nextafter(1e3, 2e3))),
        (Drive(1, GOOD), (4.0, math.inf)),
        (Drive(1, GOOD), ()),
        (Drive(1, (Knot(0, ()),)), ()),
        (Drive(math.nan, GOOD), (4.0, 4.0)),
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


def test_24_knots_262_ms_and_a_millimetre_are_the_bounds() -> None:
    knots = (*(Knot(index, (1 + 0j,)) for index in range(23)), Knot(262_000_000, (1 + 0j,)))
    assert gate(Drive(1, knots), (1e3,)) == SafeDrive(1, knots, LimitReason.NONE)
    assert gate(Drive(1, (Knot(262_000_001, (1 + 0j,)),)), (1e3,)).reasons is LimitReason.MALFORMED


def scaled_by_search(modal_um: tuple[complex, ...], limit_um: tuple[float, ...]) -> tuple[complex, ...]:
    """Float by float downwards from the least quotient, until every mode is within its limit."""
    largest = max(abs(part) for w_um in modal_um for part in (w_um.real, w_um.imag))
    unit = [complex(w_um.real / largest, w_um.imag / largest) for w_um in modal_um]
    factor = min(limit / math.hypot(u.real, u.imag) for u, limit in zip(unit, limit_um, strict=True))
    while True:
        scaled = tuple(complex(u.real * factor, u.imag * factor) for u in unit)
        if all(abs(w) <= limit for w, limit in zip(scaled, limit_um, strict=True)):
            return scaled
        factor = math.nextafter(factor, 0.0)


@pytest.mark.parametrize(
    ("modal_um", "limit_um"),
    [
        ((30 + 40j, -6 + 2j), (3.3, 4.0)),
        ((0.3 + 0.2j, -6 + 7.5j), (3.3, 4.0)),
        ((5 + 0j, 0.1j), (4.0, 4.0)),
        ((1e308 - 1.1e308j, 1e-300 + 0.5e308j), (4.0, 4.0)),
        ((0.1 + 7.4j, -5.6 - 3.9j), (4.0, 4.0)),  # the quotient is one float too large in these three
        ((-5 + 2.7j, -1.9 + 1.4j), (4.0, 4.0)),
        ((0.1 - 4.4j, -2.9 - 6.9j), (4.0, 3.3)),
        ((7.6 + 6.3j, 22.799999999999997 + 18.9j), (3.3, 9.899999999999999)),  # nearly the same quotient twice
        ((-8.1 - 8.9j, -7.3 - 8j), (4.0, 3.3)),  # two steps down
    ],
)
def test_the_common_factor_is_the_largest_that_floats_allow(
    modal_um: tuple[complex, ...], limit_um: tuple[float, ...]
) -> None:
    assert gate(drive(modal_um), limit_um).knots[0].modal_um == scaled_by_search(modal_um, limit_um)


@pytest.mark.parametrize("modal_um", [(-8.9 + 6.5j, -8 + 7.3j), (3.2 - 5.9j, -5.8 - 1.8j), (-2.4 + 8.1j, 7.4 + 5.6j)])
def test_where_the_quotient_is_floats_too_large_only_floats_are_lost(modal_um: tuple[complex, ...]) -> None:
    """The steps down grow, so the last may go too far, by no more than it is."""
    (knot,) = gate(drive(modal_um), (4.0, 3.3)).knots
    for w_um, best_um in zip(knot.modal_um, scaled_by_search(modal_um, (4.0, 3.3)), strict=True):
        assert abs(w_um - best_um) <= 4 * 2.0**-52 * abs(best_um)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_limit_of_few_subnormals_is_held_and_used(sign: int) -> None:
    """No float lies between one factor and the next here, so steps must grow until they are felt."""
    least = 5e-324
    (knot,) = gate(drive((complex(6.4, sign * 5.2),)), (2 * least,)).knots
    assert knot.modal_um == (complex(least, sign * least),)


def test_between_knots_the_interpolated_amplitude_stays_within_the_limit() -> None:
    angles = [0.0, 2.0, 4.0, 5.5]
    safe = gate(drive(*[(9 * complex(math.cos(a), math.sin(a)),) for a in angles]), (4.0,))
    for one, two in pairwise(safe.knots):
        for share in (0.1, 0.5, 0.9):
            assert abs(one.modal_um[0] * (1 - share) + two.modal_um[0] * share) <= 4.0

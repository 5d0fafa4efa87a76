"""The slew limit of two phasors: the nearest equivalent solution, and no dip that a finger feels."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given as drawn
from hypothesis import settings
from hypothesis import strategies as st

from hapticd.core.solver.points.slew_limit import Phasors2, eased, given, nearer_hand

LIMITS = (4.0, 3.0)
KEEP, UNFELT_UM = math.cos(math.pi / 16), (0.02, 0.01)

parts = st.floats(-4.0, 4.0, allow_subnormal=False)
phasors = st.tuples(parts, parts, parts, parts)
shapes = st.tuples(*[st.floats(-1.0, 1.0, allow_subnormal=False)] * 4)


def as_complex(modal: Phasors2) -> tuple[complex, complex]:
    return complex(modal[0], modal[1]), complex(modal[2], modal[3])


def within(modal: Phasors2) -> Phasors2:
    """Scaled into the limits, as every solution is."""
    a, b, c, d = modal
    excess = max(math.hypot(a, b) / LIMITS[0], math.hypot(c, d) / LIMITS[1], 1.0)
    return a / excess, b / excess, c / excess, d / excess


@settings(max_examples=200)
@drawn(phasors, phasors)
def test_the_nearer_hand_is_the_solution_or_its_mirror_image_at_the_nearest_common_phase(
    modal: Phasors2, previous: Phasors2
) -> None:
    modal = within(modal)
    near = np.array(as_complex(nearer_hand(modal, LIMITS, previous)))
    assert all(abs(w) <= limit for w, limit in zip(near.tolist(), LIMITS, strict=True))
    assert np.abs(near) == pytest.approx(np.abs(as_complex(modal)), abs=1e-12)
    now = np.array(as_complex(previous))
    distance = float(np.linalg.norm(near - now))
    for hand in (np.array(as_complex(modal)), np.conj(as_complex(modal))):
        turned = np.exp(2j * np.pi * np.arange(60) / 60)[:, None] * hand
        nearest_um = np.linalg.norm(turned - now, axis=1).min()
        assert distance <= nearest_um + 1e-7  # hands that are nearer to each other than rounding tells from 0


@settings(max_examples=200)
@drawn(phasors, phasors, shapes)
def test_no_finger_is_carried_through_a_dip_that_it_feels(
    wanted: Phasors2, previous: Phasors2, at_fingers: Phasors2
) -> None:
    wanted, previous = within(wanted), within(previous)
    reached = eased(at_fingers, LIMITS, wanted, previous, KEEP, UNFELT_UM)
    was, now = as_complex(given(at_fingers, previous)), as_complex(given(at_fingers, reached))
    arrives = reached == nearer_hand(wanted, LIMITS, previous)
    for u, v, unfelt_um in zip(was, now, UNFELT_UM, strict=True):
        sags = abs(u + v) / 2 < KEEP * min(abs(u), abs(v)) - unfelt_um - 1e-9
        assert arrives or not sags
    assert math.hypot(reached[0], reached[1]) <= LIMITS[0]
    assert math.hypot(reached[2], reached[3]) <= LIMITS[1]

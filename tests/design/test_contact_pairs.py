"""Pairs of contacts for many pairs at a time: the daemon's own rule."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.solver.contacts import contact_rms_um as plain_rms_um
from hapticd.core.solver.contacts import solve_contacts
from hapticd.design import free_plate_modes
from hapticd.design.contact_pairs import contact_rms_um, grams, random_fingers, settle, surfaces

SIZE_MM = (200.0, 200.0)
LIMITS_UM = (2.9, 2.9, 2.4, 2.4)


def test_the_descent_on_arrays_is_the_daemons_own() -> None:
    shapes = [shape for _, shape in free_plate_modes(SIZE_MM, 3.0, band_hz=(29200.0, 29500.0))][:4]
    both = grams(surfaces(shapes), random_fingers(SIZE_MM, 6, seed=2), 5.0)
    w_um = settle(both[..., 0], [both[..., 1]], 1.0, np.array(LIMITS_UM))
    for pair in range(6):
        pair_grams = [both[:, :, pair, finger].tolist() for finger in (0, 1)]
        d_um, q_um = [0.0] * 4, [0.0] * 4
        solve_contacts(pair_grams, (1.0, 0.0), LIMITS_UM, d_um, q_um)
        np.testing.assert_allclose(w_um[:, pair], np.array(d_um) + 1j * np.array(q_um), atol=1e-9)
        assert contact_rms_um(both[..., 1], w_um)[pair] == pytest.approx(plain_rms_um(pair_grams[1], d_um, q_um))

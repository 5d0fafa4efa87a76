"""Pairs of contacts for many pairs at a time: the daemon's own rule."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.core.solver.contacts import contact_rms_um as plain_rms_um
from hapticd.design import free_plate_modes
from hapticd.design.contact_pairs import contact_rms_um, grams, random_fingers, settle, surfaces

SIZE_MM = (200.0, 200.0)
LIMITS_UM = (2.9, 2.9, 2.4, 2.4)


def test_pairs_of_contacts_get_the_contrast_of_four_modes_within_the_limits() -> None:
    shapes = [shape for _, shape in free_plate_modes(SIZE_MM, 3.0, band_hz=(29200.0, 29500.0))][:4]
    both = grams(surfaces(shapes), random_fingers(SIZE_MM, 40, seed=2), 5.0)
    w_um = settle(both[..., 0], [both[..., 1]], 1.0, LIMITS_UM)
    slip_um, still_um = (contact_rms_um(both[..., finger], w_um) for finger in (0, 1))
    assert (np.abs(w_um) <= np.array(LIMITS_UM)[:, None] * (1.0 + 1e-12)).all()
    assert np.median(slip_um / still_um) > 10.0
    first_um = w_um[:, 0].real.tolist(), w_um[:, 0].imag.tolist()
    assert slip_um[0] == pytest.approx(plain_rms_um(both[:, :, 0, 0].tolist(), *first_um))

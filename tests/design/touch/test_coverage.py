"""Which part of the plate was touched least."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design.touch.coverage import map_sigma, touched_box, touched_s, where_next
from hapticd.design.touch.waves import MAP_PRIOR, Waves

from .synthetic import WAVE_RAD_MM, Touching, mode_map
from .test_fit import NOMINAL


def test_touches_of_all_places_add_up_and_a_middle_finger_is_sent_to_a_corner() -> None:
    windows = Touching(NOMINAL, seconds=3.0).windows()
    assert float(touched_s(windows, mode_map()).sum()) == pytest.approx(2.0 * 0.02 * len(windows), rel=0.02)
    windows = Touching(NOMINAL, seconds=3.0, at_rest=True, fingers=1).windows()
    assert touched_s(windows, mode_map())[1, 1] == pytest.approx(0.02 * len(windows))
    place = where_next(windows, mode_map())
    assert place[:2] == (0, 0)
    assert "0 s were at the lower left of the plate" in place.sentence(3.0)


def test_the_touched_box_holds_nearly_all_places_of_fingers() -> None:
    windows = Touching(NOMINAL, seconds=3.0).windows()
    least, largest = touched_box(windows, mode_map())
    points = windows.fingers_mm()[0].reshape(-1, 2)
    points = points[np.isfinite(points).all(axis=1)]
    assert 0.9 < float(((points >= least) & (points <= largest)).all(axis=1).mean()) < 1.0


def test_a_map_is_known_where_it_was_touched_and_as_before_elsewhere() -> None:
    modes, box = mode_map(), np.array(((20.0, 20.0), (60.0, 60.0)))
    waves = Waves(modes, WAVE_RAD_MM, touched_mm=box)
    before = np.diag(waves.prior.ravel() ** -2.0)
    sigma = map_sigma(waves, 100.0 * before, modes)
    assert sigma[2, 2] < 0.4 * map_sigma(waves, before, modes)[2, 2]
    assert sigma[0, 0] == pytest.approx(MAP_PRIOR, rel=0.1)
    assert np.argmin(sigma) == 8

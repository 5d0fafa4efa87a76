"""Which part of the plate was touched least."""

from __future__ import annotations

import pytest

from hapticd.design.touch.coverage import touched_s, where_next

from .synthetic import Touching, mode_map
from .test_fit import NOMINAL


def test_the_time_of_all_places_is_that_of_all_fingers() -> None:
    windows = Touching(NOMINAL, seconds=3.0).windows()
    assert float(touched_s(windows, mode_map()).sum()) == pytest.approx(2.0 * 0.02 * len(windows), rel=0.02)


def test_a_finger_that_stays_in_the_middle_is_sent_to_a_corner() -> None:
    windows = Touching(NOMINAL, seconds=3.0, at_rest=True, fingers=1).windows()
    assert touched_s(windows, mode_map())[1, 1] == pytest.approx(0.02 * len(windows))
    place = where_next(windows, mode_map())
    assert place[:2] == (0, 0)
    assert "0 s were at the lower left of the plate" in place.sentence(3.0)

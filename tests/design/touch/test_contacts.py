"""How large contacts are, by the load of fingers, and what that says of the pad's ellipses."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.design.touch.contacts import RADII_MM, TouchSizes, contact_sizes, ellipse_law, spreads_of
from hapticd.design.touch.fit import fit
from hapticd.design.touch.model import Calibration, Free

from .synthetic import Touching, mode_map

NOMINAL = Calibration.nominal(2)
TRUE_MM = np.array((4.0, 6.0))
LAW = (1.3, 0.5)  # scale and offset


def test_a_fingers_load_shows_how_large_it_is() -> None:
    windows = Touching(NOMINAL, noise_um_s=0.3, radii_mm=(4.0, 6.0)).windows()
    sizes = contact_sizes(fit(windows, mode_map(), Free(pad=True, sense=True), NOMINAL), mode_map())
    assert np.abs(sizes.radius_mm - TRUE_MM).max() < 0.4
    assert sizes.mean_mm()[0] == pytest.approx(5.0, abs=0.3)
    points = Touching(NOMINAL, seconds=6.0, noise_um_s=0.3).windows()
    assert contact_sizes(fit(points, mode_map(), Free(), NOMINAL), mode_map()).radius_mm.max() < 2.0


def test_a_larger_disc_has_more_of_its_load_beside_its_centre() -> None:
    spreads_mm2 = spreads_of(RADII_MM, mode_map())
    assert (np.diff(spreads_mm2) > 0.0).all()
    assert spreads_mm2[0] == pytest.approx(RADII_MM[0] ** 2 / 4.0, rel=0.03)  # of a small one, a quarter of the square


def sizes_of(radii_mm: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> TouchSizes:
    return TouchSizes(radii_mm, np.full(len(radii_mm), 0.3))


def test_fingers_of_different_sizes_have_a_mean_that_is_known_as_well_as_each() -> None:
    mean_mm, sigma_mm = sizes_of(TRUE_MM).mean_mm()
    assert mean_mm == pytest.approx(5.0)
    assert sigma_mm == pytest.approx(0.3 / np.sqrt(2.0))


def test_two_sizes_give_the_law_of_the_pad_s_ellipses() -> None:
    radii_mm = np.tile((3.5, 6.5), 20)
    law = ellipse_law(sizes_of(radii_mm), (2.0 * radii_mm - LAW[1]) / LAW[0])
    assert law is not None
    assert law.scale == pytest.approx(LAW[0], abs=0.05)
    assert law.offset_mm == pytest.approx(LAW[1], abs=0.4)


def test_one_size_tells_the_scale_alone_and_no_or_unknown_ones_no_law() -> None:
    law = ellipse_law(sizes_of(np.array((5.0, 5.0))), np.array((8.0, 8.0)))
    assert law is not None
    assert 0.5 * (law.scale * 8.0 + law.offset_mm) == pytest.approx(5.0, abs=0.1)
    assert abs(law.offset_mm) < 0.2
    assert ellipse_law(sizes_of(TRUE_MM), np.full(2, np.nan)) is None
    assert ellipse_law(TouchSizes(TRUE_MM, np.full(2, 3.0)), 2.0 * TRUE_MM) is None

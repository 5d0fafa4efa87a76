"""What is not known of the plate: what is to be expected of a contact's amplitude, and its interval."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pipeline_bench import PLATE

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.core.perception import ContactPerception
from hapticd.core.uncertainty import Uncertainty, interval_um

MODAL_UM = (1.0 + 0.5j, -0.7j)
SIZE_UM = math.sqrt(1.0 + 0.25 + 0.49)
NODE_MM, CREST_MM = 0.0, 27.0 / 4.0  # of mode X


def test_what_is_certain_has_no_interval() -> None:
    assert interval_um(0.25, 0.0) == (0.5, 0.5)
    low_um, high_um = interval_um(0.0, 1e-200)  # a plate that is nearly at rest
    assert 0.0 < low_um < 1e-100 < high_um < 1e-99
    found = ContactPerception(DEFAULT_FRICTION_CURVE, 5.0).felt(PLATE, CREST_MM, 3.0, MODAL_UM, 1.0)
    assert found.low == found.friction == found.high
    assert found.amplitude.low_um == found.amplitude.rms_um == found.amplitude.high_um


@pytest.mark.parametrize(("sure_um", "unsure_um"), [(0.0, 0.1), (0.1, 0.1), (1.0, 0.1), (0.3, 0.6)])
def test_nine_of_ten_contacts_with_random_errors_are_in_the_interval(sure_um: float, unsure_um: float) -> None:
    random = np.random.default_rng(5)
    errors = random.normal(size=(2, 20_000)) * unsure_um / math.sqrt(2.0)
    low_um, high_um = interval_um(sure_um**2, unsure_um**2)
    size_um = np.hypot(sure_um + errors[0], errors[1])
    assert np.mean((low_um <= size_um) & (size_um <= high_um)) == pytest.approx(0.9, abs=0.03)


def test_errors_of_map_and_sensors_add_in_quadrature() -> None:
    sure = ContactPerception(DEFAULT_FRICTION_CURVE, 5.0)
    of_map = ContactPerception(DEFAULT_FRICTION_CURVE, 5.0, Uncertainty(map_frac=0.03))
    base_um = sure.felt(PLATE, NODE_MM, 0.0, MODAL_UM, 1.0).amplitude.rms_um
    found = of_map.felt(PLATE, NODE_MM, 0.0, MODAL_UM, 1.0)
    assert found.amplitude.rms_um == pytest.approx(math.hypot(base_um, 0.03 * SIZE_UM), rel=1e-6)
    assert found.low < found.friction < found.high
    at_point = ContactPerception(DEFAULT_FRICTION_CURVE, 0.0, Uncertainty(sensors_frac=0.03))
    (shapes,) = PLATE.evaluate([(CREST_MM, 3.0)])
    w_um = abs(sum(phi * one_um for phi, one_um in zip(shapes, MODAL_UM, strict=True)))
    expected_um = math.hypot(w_um, 0.03 * SIZE_UM * math.hypot(*shapes))
    assert at_point.amplitude(PLATE, CREST_MM, 3.0, MODAL_UM, 0.0).rms_um == pytest.approx(expected_um, rel=1e-6)

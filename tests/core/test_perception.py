"""The mean friction over a contact."""

from __future__ import annotations

import math

import numpy as np
import pytest
from pipeline_bench import PLATE

from hapticd.core.friction import FrictionCurve
from hapticd.core.perception import ContactPerception

CURVE = FrictionCurve.from_amplitudes((0.0, 1.0, 3.0), floor_frac=0.2)  # 1 um: 0.6 of bare glass's friction
CREST_MM = 27.0 / 4.0  # where mode X of the bench's plate is 1
AT_MODE_X = (1.0, 0.0)


def test_over_a_contact_it_is_the_mean_of_many_points() -> None:
    radius_mm, (x_mm, y_mm) = 5.0, (0.0, 3.0)
    grid_mm = (np.arange(400) + 0.5) / 200.0 * radius_mm - radius_mm
    dx_mm, dy_mm = (part.ravel() for part in np.meshgrid(grid_mm, grid_mm))
    inside = np.hypot(dx_mm, dy_mm) < radius_mm
    points_mm = np.column_stack((x_mm + dx_mm[inside], y_mm + dy_mm[inside]))
    modal_um = (1.0 + 0.5j, -0.7j)
    w_um = np.abs(PLATE.evaluate(points_mm) @ np.array(modal_um))
    found = ContactPerception(CURVE, radius_mm).felt(PLATE, x_mm, y_mm, modal_um, 1.0)
    assert found.friction == pytest.approx(float(np.mean(CURVE.frictions(w_um, np.zeros(1)))), rel=0.01)
    assert found.amplitude.rms_um == pytest.approx(math.sqrt(np.mean(w_um**2)), rel=0.01)


def test_a_sliding_finger_feels_less_of_the_vibration_and_asks_for_more() -> None:
    contacts = ContactPerception(CURVE, 0.0)
    found = contacts.felt(PLATE, CREST_MM, 0.0, AT_MODE_X, 2.0)
    assert found.friction == pytest.approx(0.6**0.5, abs=1e-3)
    assert found.amplitude.rms_um == pytest.approx(1.0, abs=1e-3)
    assert contacts.asked(2.0, 2.0) == CURVE.friction(1.0)

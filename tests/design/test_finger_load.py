"""A finger's load, learned from touches: where it is found, and where nothing is adopted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.core.plate.parasitic_modes import ParasiticModes
from hapticd.design.finger_load import learned_1_s
from hapticd.design.touch.model import Calibration
from hapticd.design.touch.observations import Windows

from .touch.synthetic import DECAY_1_S as DECAY_OF_PLATE_1_S
from .touch.synthetic import Touching, mode_map

NOMINAL = Calibration.nominal(2)
DECAY_1_S, DETUNING_RAD_S = (180.0, 185.0), (470.0, 590.0)


def parasitic_modes(finger_decay_1_s: float, finger_detuning_rad_s: float = 0.0) -> ParasiticModes:
    """Parasitic modes that hardly move: the synthetic plate has none."""
    modes = mode_map()
    faint = ModeShapes(modes.x_mm, modes.y_mm, 1e-3 * modes.shapes)
    return ParasiticModes(faint, DECAY_1_S, DETUNING_RAD_S, finger_decay_1_s, finger_detuning_rad_s)


def learned(windows: Windows, modes: ParasiticModes) -> complex | None:
    return learned_1_s(windows, mode_map(), modes, DECAY_OF_PLATE_1_S.tolist(), NOMINAL)


def test_damping_and_detuning_of_fingers_are_learned_from_touches() -> None:
    truth_1_s = 230.0 - 400.0j
    found_1_s = learned(Touching(NOMINAL, seconds=8.0, load_1_s=truth_1_s).windows(), parasitic_modes(100.0))
    assert abs(found_1_s - truth_1_s) < 0.1 * abs(truth_1_s)


def test_a_load_that_is_known_is_left_as_it_is() -> None:
    windows = Touching(NOMINAL, seconds=8.0, load_1_s=230.0 - 400.0j).windows()
    assert learned(windows, parasitic_modes(210.0, 380.0)) is None


def test_a_short_touch_and_fingers_that_feel_nothing_tell_no_load() -> None:
    assert learned(Touching(NOMINAL, seconds=3.0, load_1_s=300.0).windows(), parasitic_modes(100.0)) is None
    windows = Touching(NOMINAL, seconds=8.0, load_1_s=300.0).windows()
    rng = np.random.default_rng(1)
    noise_v = rng.standard_normal((2, *windows.voltage_v.shape)) * 300.0
    drowned = replace(windows, voltage_v=windows.voltage_v + noise_v[0] + 1j * noise_v[1])
    assert learned(drowned, parasitic_modes(100.0)) is None

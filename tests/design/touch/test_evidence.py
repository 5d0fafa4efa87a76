"""What touches say of a calibration that they did not teach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.design.touch.evidence import Taken, gained
from hapticd.design.touch.model import Calibration

from .synthetic import Touching, mode_map
from .test_fit import NOMINAL, WRONG

CONFIGURED = Taken.as_configured(mode_map())


def taken(found: Calibration) -> Taken:
    return Taken(CONFIGURED.modes, found)


def test_what_is_right_is_confirmed_and_its_opposite_refuted() -> None:
    windows = Touching(WRONG, seconds=8.0).windows()
    better = gained(windows, CONFIGURED, taken(WRONG))
    opposite = replace(WRONG, pad=-WRONG.pad, sense=2.0 * np.eye(2) - WRONG.sense)
    worse = gained(windows, CONFIGURED, taken(opposite))
    assert better is not None
    assert worse is not None
    assert (better.is_sure, better.is_worse) == (True, False)
    assert (worse.is_sure, worse.is_worse) == (False, True)


def test_a_pad_that_moved_back_refutes_what_was_adopted() -> None:
    gain = gained(Touching(NOMINAL, seconds=8.0).windows(), CONFIGURED, taken(WRONG))
    assert gain is not None
    assert gain.is_worse


def test_what_changes_nothing_is_neither() -> None:
    gain = gained(Touching(NOMINAL, seconds=8.0).windows(), CONFIGURED, CONFIGURED)
    assert gain == pytest.approx((0.0, 0.0), abs=1e-6)
    assert gain is not None
    assert not gain.is_sure
    assert not gain.is_worse


def test_three_seconds_say_nothing() -> None:
    assert gained(Touching(WRONG, seconds=3.0).windows(), CONFIGURED, taken(WRONG)) is None

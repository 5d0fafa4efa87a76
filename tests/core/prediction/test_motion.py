"""The motion models, each on the motion that it describes exactly, and against the books' matrices."""

from __future__ import annotations

import pytest

from hapticd.core.prediction.bank import ModelBank
from hapticd.core.prediction.motion import Sample

PERIOD_S = 0.01125


def test_the_bank_changes_from_rest_to_motion_and_back_within_eight_samples() -> None:
    bank = ModelBank(period_ms=11.25)
    bank.start(0.0, 0.0)
    for _ in range(500):
        bank.step(Sample(PERIOD_S, PERIOD_S, 0.0, 0.0))
    assert bank.velocity(0.0) == (0.0, 0.0)
    for k in range(1, 9):
        bank.step(Sample(PERIOD_S, PERIOD_S, 2.0 * k, 0.0))
    assert bank.velocity(0.0)[0] == pytest.approx(2.0 / PERIOD_S, rel=0.1)
    for _ in range(8):
        bank.step(Sample(PERIOD_S, PERIOD_S, 16.0, 0.0))
    assert abs(bank.velocity(0.0)[0]) < 5.0
    assert bank.position(0.015)[0] == pytest.approx(16.0, abs=0.1)

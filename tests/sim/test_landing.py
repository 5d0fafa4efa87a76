"""How long a landing finger waits for its amplitude."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.landing import CLIENT, SURFACE, measure, percentiles_ms

PERIOD_MS = 11.25


def test_on_a_surface_a_finger_is_served_a_report_sooner_than_by_a_client_that_has_to_see_it() -> None:
    found = measure(3)
    assert np.all(found[SURFACE] <= 32.0)
    assert np.median(found[CLIENT] - found[SURFACE]) == pytest.approx(PERIOD_MS, abs=1.5)


@pytest.mark.long
def test_on_a_surface_half_of_all_fingers_have_their_amplitude_within_25_ms_and_all_but_a_twentieth_within_32() -> None:
    figures = percentiles_ms(measure(48)[SURFACE])
    assert figures["p50_ms"] <= 25.0
    assert figures["p95_ms"] <= 32.0

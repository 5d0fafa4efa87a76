"""The simulated client: which finger is whose."""

from __future__ import annotations

import numpy as np
import pytest

from hapticd.sim.fingers.scenarios import LAND_S, SCENARIOS
from hapticd.sim.fingers.scripted import ScriptedClient


@pytest.mark.parametrize("early_s", [-0.02, 0.001, 0.02])
def test_fingers_are_distinguished_also_where_they_seem_to_land_too_early(early_s: float) -> None:
    """As in a laboratory whose pad reports sooner than it is configured to."""
    actors = SCENARIOS["strokes"].build(58, 100.0)
    client = ScriptedClient(actors)
    places = [actor.path.position_mm(np.array([LAND_S + 0.03]))[0] for actor in actors if actor.path is not None]
    fingers = [(10 + index, *map(float, place)) for index, place in enumerate(places)]
    client.message(LAND_S + 0.03, LAND_S - early_s, list(reversed(fingers)))
    assert client.actor_of == {10: 0, 11: 1}

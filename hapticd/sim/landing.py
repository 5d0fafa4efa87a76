"""From a finger's landing to its amplitude, on the simulated rig in virtual time.

Fingers land at random phases of the pad's scan, where the plate can give them 1 um, and stay there. Counted from the
first true contact until the plate has 90 % of it under the finger, in two ways: a surface lies there already, or a
client that sees the finger in a state sends its target. That client answers at once; a real one takes some
milliseconds, and a target that misses a pass waits for the next report.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from hapticd_contract.contents import Amplitude
from hapticd_contract.surfaces import Surface
from hapticd_contract.targets import ClientTargets

from .fingers.paths import Rest, Touch, Touches
from .fingers.scenarios import Actor
from .lockstep import Simulation
from .plate.glasses import find_glass
from .plate.ground_truth import GroundTruth
from .settings import Settings

TARGET_UM = 1.0
REACHED_FRAC = 0.9
LANDINGS = 96
SURFACE, CLIENT = "surface", "client sees the finger first"
PER_RUN = 8
_FIRST_S, _EVERY_S, _TOUCH_S = 0.7, 0.25, 0.12  # the handshake takes 0.4 s
_SPARE = 2.0  # the plate can do so many times the target
_TTL_NS, _REFRESH_NS = 500_000_000, 150_000_000


class _WithSurface(Simulation):
    """The same fingers without a client that watches them, on a surface that covers the plate."""

    _t_published_ns = 0

    def _send_targets(self, t_ns: int) -> None:
        super()._send_targets(t_ns)  # none: its actors have no targets
        if t_ns - self._t_published_ns >= _REFRESH_NS:
            self._t_published_ns = t_ns
            surfaces = {"plate": Surface.of(Amplitude(TARGET_UM))}
            self.machine.set_targets(ClientTargets.of("surface", _TTL_NS, {}, {}, surfaces=surfaces), t_ns)


def measure(
    landings: int = LANDINGS, *, progress: Callable[[float], None] = lambda _: None
) -> Mapping[str, npt.NDArray[np.float64]]:
    """Return by way how long each of the same landings took, in ms; inf where the finger never got its amplitude."""
    found: dict[str, list[npt.NDArray[np.float64]]] = {SURFACE: [], CLIENT: []}
    for first in range(0, landings, PER_RUN):
        count = min(PER_RUN, landings - first)
        for way, spans_ms in found.items():
            spans_ms.append(_spans_ms(Settings(), first, count, with_surface=way == SURFACE))
        progress((first + count) / landings)
    return {way: np.concatenate(spans_ms) for way, spans_ms in found.items()}


def percentiles_ms(spans_ms: npt.NDArray[np.float64]) -> dict[str, float]:
    """Return the figures of one way; the 95 % are those of a landing that was measured."""
    p50_ms, p95_ms = np.percentile(spans_ms, [50, 95], method="higher").tolist()
    return {"p50_ms": p50_ms, "p95_ms": p95_ms, "max_ms": float(spans_ms.max())}


def _spans_ms(settings: Settings, seed: int, count: int, *, with_surface: bool) -> npt.NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    landed_s = _FIRST_S + _EVERY_S * np.arange(count) + rng.uniform(0.0, 0.1, count)
    places_mm = _places_mm(settings, rng, count)
    touches = tuple(
        Touch(Rest(place_mm), down_s, down_s + _TOUCH_S)
        for place_mm, down_s in zip(places_mm, landed_s.tolist(), strict=True)
    )
    fingers = (Actor(() if with_surface else ((0.0, TARGET_UM),), path=Touches(touches)),)
    simulation = _WithSurface(fingers, settings, seed) if with_surface else Simulation(fingers, settings, seed)
    simulation.run(_FIRST_S + _EVERY_S * count + _TOUCH_S)
    run = simulation.result("landing")
    spans_ms = np.full(count, np.inf)
    for index, down_s in enumerate(landed_s):
        is_touch = (run.t_s >= down_s) & (run.t_s < down_s + _TOUCH_S)
        reached_s = run.t_s[is_touch & (np.abs(run.truth_um[:, 0]) >= REACHED_FRAC * TARGET_UM)]
        if reached_s.size:
            spans_ms[index] = 1e3 * (reached_s[0] - down_s)
    return spans_ms


def _places_mm(settings: Settings, rng: np.random.Generator, count: int) -> list[tuple[float, float]]:
    """Draw places where the plate can do more than the target."""
    plate = GroundTruth(settings.plate)
    reach_mm = 0.35 * min(find_glass(settings.plate.plate).size_mm)
    candidates_mm = rng.uniform(-reach_mm, reach_mm, (50 * count, 1, 2))
    phi = plate.shapes(candidates_mm)[:, 0, : plate.settings.driven_modes]
    most_um = np.abs(phi) @ np.asarray(plate.w_limit_um)
    return [(x_mm, y_mm) for x_mm, y_mm in candidates_mm[most_um >= _SPARE * TARGET_UM, 0][:count].tolist()]

"""Persons' friction curves by comparison with a reference, of simulated observers: error, honesty of the interval."""

from __future__ import annotations

import numpy as np

from ..design.person import TRIALS, calibrated
from ..sim.observer import KINDS, REFERENCE, ObserverKind, SimulatedObserver
from .tables import Table

OBSERVERS = 200
COMPARISON_S = 4.5  # a second on the plate, one on the reference, one key
NOTES = ("RMS of the decay of friction with amplitude, and before; covered: within the interval of 95 %",)


def run(observers: int = OBSERVERS) -> tuple[Table, ...]:
    """Calibrate observers of each kind."""
    rows = {}
    for place, (name, kind) in enumerate(KINDS.items()):
        seeds = range(place * observers, (place + 1) * observers)
        off, before, covered = np.array([_one(kind, seed) for seed in seeds]).T
        rows[name] = {
            "error_percent": 100.0 * float(np.sqrt(np.mean(off**2))),
            "before_percent": 100.0 * float(np.sqrt(np.mean(before**2))),
            "covered_percent": 100.0 * float(covered.mean()),
            "time_min": TRIALS * COMPARISON_S / 60.0,
        }
    return (Table("persons", f"calibrate person: {observers} observers of each kind", rows, NOTES),)


def _one(kind: ObserverKind, seed: int) -> tuple[float, float, bool]:
    observer = SimulatedObserver(kind, seed)
    found, true_um = calibrated(observer.compare, REFERENCE), observer.curve.decay_um(0.0)
    return true_um / found.decay_um - 1.0, true_um / 0.7 - 1.0, found.low_um <= true_um <= found.high_um

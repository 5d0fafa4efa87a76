"""Mistakes of a new rig, of random size and place: what a technician can have done, by `Flaw`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hapticd.design.commissioning.findings import Flaw

KINDS = tuple(Flaw)
_PAIRS = {
    Flaw.SENSORS_SHORTED,
    Flaw.SENSORS_SWAPPED,
    Flaw.DRIVES_SHORTED,
    Flaw.AMPLIFIERS_SWAPPED,
}
_ONE_WIRE = {
    Flaw.SENSOR_OFFSET,
    Flaw.SENSOR_NOISY,
    Flaw.SENSOR_FLOATING,
    Flaw.SENSOR_OPEN,
    Flaw.SENSOR_INVERTED,
    Flaw.SENSOR_GAIN,
    Flaw.PREAMPLIFIER_CLIPS,
    Flaw.DRIVE_OPEN,
    Flaw.AMPLIFIER_INVERTED,
    Flaw.AMPLIFIER_GAIN,
    Flaw.GLUE,
    Flaw.PATCH_CRACKED,
}
# With one of these the loop would be unstable, or blind.
DANGEROUS = frozenset(
    {
        Flaw.SENSOR_FLOATING,
        Flaw.SENSOR_OPEN,
        Flaw.SENSORS_SHORTED,
        Flaw.SENSORS_SWAPPED,
        Flaw.SENSOR_INVERTED,
        Flaw.SENSOR_GAIN,
        Flaw.DRIVE_OPEN,
        Flaw.DRIVES_SHORTED,
        Flaw.AMPLIFIERS_SWAPPED,
        Flaw.AMPLIFIER_INVERTED,
        Flaw.AMPLIFIER_GAIN,
    }
)
# Range of a mistake's size, and its unit; the logarithm is uniform. A negative size is drawn as often as a positive one
# where _SIGNED has it.
_SIZES = {
    Flaw.SUPPLY_LOW: (0.35, 0.8),  # of the supply
    Flaw.SENSOR_OFFSET: (90.0, 1500.0),  # steps of the converter, of 0.8 mV
    Flaw.MAINS_HUM: (100.0, 900.0),  # steps
    Flaw.SENSOR_NOISY: (8.0, 40.0),  # steps, standard deviation of a sample
    Flaw.SENSOR_FLOATING: (100.0, 600.0),  # steps of hum
    Flaw.PREAMPLIFIER_CLIPS: (0.25, 0.65),  # of the amplitude at a fifth of the voltage
    Flaw.GLUE: (2.0, 3.0),  # times the decay of all modes, and less force by as much at its patch
    Flaw.PATCH_CRACKED: (0.45, 0.55),  # of force and capacitance
    Flaw.DIMENSIONS: (0.01, 0.06),  # of all frequencies
}
_SIGNED = {Flaw.SENSOR_OFFSET, Flaw.DIMENSIONS}


@dataclass(frozen=True, slots=True)
class Mistake:
    """A mistake at `wires` (amplifiers, sensors or patches, by its cause), of a size that its cause defines."""

    cause: Flaw
    wires: tuple[int, ...] = ()
    size: float = 1.0


def random_mistake(cause: Flaw, modes: int, random: np.random.Generator) -> Mistake:
    """Return a mistake of this cause on a rig with so many modes."""
    count = 2 if cause in _PAIRS else 1 if cause in _ONE_WIRE else 0
    wires = tuple(sorted(random.choice(modes, count, replace=False).tolist()))
    if cause in (Flaw.SENSOR_GAIN, Flaw.AMPLIFIER_GAIN):
        size = float(random.choice((0.1, 10.0)))
    elif cause is Flaw.STOP_LINE:
        size = float(random.choice((0.0, 1.0)))
    else:
        low, high = _SIZES.get(cause, (1.0, 1.0))
        size = float(np.exp(random.uniform(np.log(low), np.log(high))))
    sign = float(random.choice((-1.0, 1.0))) if cause in _SIGNED else 1.0
    return Mistake(cause, wires, sign * size)

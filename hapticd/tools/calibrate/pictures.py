"""Plain-text pictures for the terminal: where to put the probe, and small charts of what was measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...values import FloatArray

WIDTH, HEIGHT = 61, 8  # of a chart
SHADES = " .:-=+*#%@"

SUPPLY = """\
   3.3 V pin ----o meter     +24 V o---+---o drive
   ADC pin k ----o meter, DC   0 V o---+
   ground    ----o           -24 V o---+---o drive

   PB14 (PC6) o--[thermostat]----o ground
   PB15 (PC7) o--[stop, closed]--o ground
"""
REST = """\
   plate  |~~~~~~  no drive, no finger on it

   sensor k --coax--> front end --> ADC k
                                    noise? hum?
"""
ANSWER = """\
   DAC k --> amplifier k --+--> patch k ==+
                           |              | plate
                         scope            |
   ADC k <-------------------- sensor k ==+

   scope: 1 V peak at the patch, and its sign
          against the DAC's pin
"""
POLARITY = """\
   drive    /\\    /\\    /
           /  \\  /  \\  /
          /    \\/    \\/

   sensor     /\\    /\\     right: at resonance it
             /  \\  /  \\           lags by a quarter
            /    \\/    \\    inverted: it leads
"""
DEADMAN = """\
   computer ===X=== board --> amplifiers

   the cable is pulled while a voltage stands:
   50 ms later it ramps to zero
"""
STOP = """\
   (( STOP ))---- pole 1: rails
             +--- pole 2: enable
             +--- pole 3: PB15 (G474, H743: PC7)
"""
LOOP = """\
   reference --> [ law ] --> amplifier --> plate
                    ^                        |
                    +-------- sensor <-------+
"""
TOUCH = """\
        finger
          v
   =======+=======  the plate is held at 0.5 um
"""


def chart(x: FloatArray, curves: Sequence[FloatArray], unit: str) -> str:
    """Return curves (n,) over x (n,) as lines of text, the k-th drawn with the digit k."""
    most = max((float(np.max(curve)) for curve in curves), default=0.0) or 1.0
    grid = [[" "] * WIDTH for _ in range(HEIGHT)]
    span = float(np.ptp(x)) or 1.0
    for k, curve in enumerate(curves):
        for at, value in zip(x, curve, strict=True):
            column = round((WIDTH - 1) * (float(at) - float(x.min())) / span)
            row = HEIGHT - 1 - round((HEIGHT - 1) * max(float(value), 0.0) / most)
            grid[row][column] = str(k % 10)
    rows = ["".join(row).rstrip() for row in grid]
    return "\n".join(
        [
            f"   {most:.3g} {unit}",
            *(f"   |{row}" for row in rows),
            f"   +{'-' * WIDTH}",
            f"   {x.min():.0f} .. {x.max():.0f} Hz",
        ]
    )


def matrix(shares: FloatArray, rows: str, columns: str) -> str:
    """Return a matrix as shades: the darkest is its largest element."""
    most = float(np.abs(shares).max()) or 1.0
    head = f"   {rows} \\ {columns}  " + " ".join(f"{column:^3}" for column in range(shares.shape[1]))
    lines = [head]
    for place, row in enumerate(np.abs(shares) / most):
        shades = " ".join(SHADES[round(float(value) * (len(SHADES) - 1))] * 3 for value in row)
        lines.append(f"   {place:>{len(rows)}}   {' ' * len(columns)}  {shades}")
    return "\n".join(lines)

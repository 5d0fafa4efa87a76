"""Copies of a plate as they may be made: `fingertip#17` is the plate of `--plate fingertip --copy 17`.

A copy is one of those by which `hapticd plate --felt --tolerances` judges a design. It is set up from its scan: its
drive and its driven modes are those that `design.mode_choice` chooses, and its undriven modes are pushed by the patches
as far as these push them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hapticd.design.felt_tolerances import Copy
from hapticd.design.glued_plate import GluedPlate
from hapticd.design.mode_choice import FeltTask, choose
from hapticd.design.mode_shape import distinct_names
from hapticd.errors import SimulationError


def set_up(drawn: GluedPlate, drive_hz: float, number: int) -> dict[str, Any]:
    """Return the values of a `CopiedGlass`, set up from its scan: this takes some seconds. Raises SimulationError."""
    if not drawn.patches:
        raise SimulationError("this plate has no copies, as it has no patches: give fingertip, wide, or a file.")
    copy = Copy(drawn, drive_hz, FeltTask(), number)
    modes = copy.modes()
    near = modes.shown()
    choice = choose(near, copy.task)
    if choice is None:
        raise SimulationError(f"copy {number} has no drive near enough to its modes: give another one.")
    used, rest = list(choice.used), near.undriven(choice.used)
    own = near.of(used)
    pushed = np.abs(near.pushed(used, choice.drive_hz)).max(axis=1)
    rest = [rest[at] for at in np.argsort(-pushed).tolist()]
    pushes = near.driven.gain_um_per_v_s[rest] @ own.volts_per_um_s
    resonance_gain = np.abs(own.stiffness_1_s(choice.drive_hz)) / own.decay_1_s
    names, made = distinct_names(modes.modes), modes.plate
    of = made.material
    return {
        "size_mm": made.size_mm,
        "thickness_mm": made.thickness_mm,
        "band_hz": modes.solved_hz,
        "drive_hz": choice.drive_hz,
        "modes": tuple(names[mode] for mode in (*used, *rest)),
        "driven": len(used),
        "reach_um": tuple((np.array(choice.limits_um) * resonance_gain).tolist()),
        "material": f"{of.young_gpa!r},{of.poisson!r},{of.density_kg_m3!r}",
        "patches": tuple((p.x_mm, p.y_mm, *p.size_mm, p.thickness_mm) for p in made.patches),
        "made": made,
        "pushes": tuple(map(tuple, pushes.tolist())),
    }

"""Tables and JSON of `hapticd plate --felt`, of plates for whole fingertips."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..design.felt_search import FeltDesign
from ..design.felt_tolerances import Tolerances
from ..design.mode_choice import MOST_UM, FeltTask
from ..design.patch_reach import charge_nc_um, moving_ma, patch_load
from ..design.plate_bounds import Bound, most
from ..values import FloatArray
from . import outputs, plate_places
from .plate_places import Placement
from .plate_verdict import FeltMotion

ROWS = 12


def _size(values_mm: Sequence[float]) -> str:
    return "x".join(f"{mm:g}" for mm in values_mm)


def _kit(design: FeltDesign) -> str:
    patch = design.plate.patches[0]
    return _size((*sorted(patch.size_mm, reverse=True), patch.thickness_mm))


def designs_table(designs: Sequence[FeltDesign], studies: Sequence[Tolerances]) -> str:
    """Return the best designs, a row each; `studies` are of the first ones."""
    lines = [
        "   with their patches, for fingers at rest; of copies nine in ten have more",
        "   plate mm        patches mm  drive Hz modes farthest next Hz  felt copies  each finger        within volts",
    ]
    for place, one in enumerate(designs[:ROWS], 1):
        each = " ".join(f"{100 * share:3.0f} %" for share in one.each_frac)
        following = f"{one.next_hz:7.0f}" if math.isfinite(one.next_hz) else "      -"
        tenth = f"{100 * studies[place - 1].tenth_frac:4.0f} %" if place <= len(studies) else "     -"
        lines.append(
            f"{place:>2} {_size((*one.plate.size_mm, one.plate.thickness_mm)):<15} {_kit(one):<11} {one.drive_hz:8.0f} "
            f"{len(one.modes):5} {one.farthest_hz:8.0f} {following} {100 * one.felt_frac:3.0f} % {tenth}  {each:<18} "
            f"{100 * one.fits_frac:3.0f} %"
        )
    if len(designs) > ROWS:
        lines.append(f"   and {len(designs) - ROWS} more")
    return "\n".join(lines)


def patch_table(design: FeltDesign) -> str:
    """Return the patches: places, volts, currents."""
    lines = [
        "",
        "patch     x mm    y mm  along x, y mm   volts, 95 % of places and most   nF glued, free"
        "   mA peak, RMS     VA   modes' mA",
    ]
    moving = _moving_ma(design)
    for index, patch in enumerate(design.plate.patches):
        used_v = most(design.patch_v[:, index])
        load = patch_load(patch, design.drive_hz, design.driven.most_v[index])
        lines.append(
            f"{index + 1:>5} {patch.x_mm:8.2f} {patch.y_mm:7.2f}  {_size(patch.size_mm):<13}   {used_v:4.0f} "
            f"{load.volts_v:4.0f} {load.glued_nf:27.2f} {load.free_nf:5.2f} {load.peak_ma:9.0f} {load.rms_ma:5.0f} "
            f"{load.apparent_va:6.1f} {moving[index]:11.1f}"
        )
    lines.append(
        "Current and power: by the glued capacitance, at the most volts. Modes' mA: at their limits, peak, at most."
    )
    return "\n".join(lines)


def _moving_ma(design: FeltDesign) -> FloatArray:
    plate = design.plate
    charge = charge_nc_um(plate.thickness_mm, plate.patches, design.shapes)
    return moving_ma(charge, design.drive_hz, np.array(design.limits_um))


def mode_table(design: FeltDesign) -> str:
    """Return the modes: what each reaches alone, and its limits."""
    alone_um = design.driven.reach_um(design.drive_hz)
    lines = ["", " mode Hz   alone, volts for 1 um   reach alone um   limit um   limit at resonance um   name"]
    for (hz, shape), most_um, limit_um, reach_um, volts in zip(
        design.modes, alone_um, design.limits_um, design.reach_um, design.driven.most_v.max() / alone_um, strict=True
    ):
        lines.append(f"{hz:8.0f} {volts:23.1f} {most_um:16.2f} {limit_um:10.2f} {reach_um:23.2f}   {shape.name}")
    lines.append(
        f"Limits are {design.share:.0%} of the reach alone, at most {MOST_UM:g} um: modes that move together share the "
        "patches."
    )
    return "\n".join((*lines, ""))


def write_json(
    designs: Sequence[FeltDesign],
    task: FeltTask,
    asked: Sequence[Bound],
    motion: FeltMotion | str,
    studies: Sequence[Tolerances],
    placement: Placement,
    file: str,
) -> None:
    """Write the designs, the bounds of the best one and how it was judged. Raises HapticdError."""
    table: dict[str, Any] = {
        "targets_um": task.targets_um,
        "designs": [_as_json(one) for one in designs],
        "bounds": [
            {"name": one.name, "value": one.value, "most": one.most, "unit": one.unit, "known": one.known}
            for one in asked
        ],
        "motion": {"unknown": motion} if isinstance(motion, str) else motion._asdict(),
        "placement": plate_places.as_json(placement),
        "tolerances": [{"nominal_frac": nominal, "felt_frac": found.tolist()} for _, nominal, found in studies],
    }
    outputs.write_json(table, file)


def _as_json(design: FeltDesign) -> dict[str, Any]:
    of = design.plate.material
    return {
        "size_mm": design.plate.size_mm,
        "thickness_mm": design.plate.thickness_mm,
        "material": [of.young_gpa, of.poisson, of.density_kg_m3],
        "drive_hz": design.drive_hz,
        "modes": [shape.name for shape in design.shapes],
        "frequency_hz": design.frequency_hz,
        "next_hz": design.next_hz if math.isfinite(design.next_hz) else None,
        "patches": [[one.x_mm, one.y_mm, *one.size_mm, one.thickness_mm] for one in design.plate.patches],
        "loads": [
            asdict(patch_load(patch, design.drive_hz, volts_v))
            for patch, volts_v in zip(design.plate.patches, design.driven.most_v.tolist(), strict=True)
        ],
        "moving_ma": _moving_ma(design).tolist(),
        "reach_alone_um": design.driven.reach_um(design.drive_hz).tolist(),
        "limits_um": design.limits_um,
        "reach_um": design.reach_um,
        "felt_frac": design.felt_frac,
        "each_frac": design.each_frac,
        "within_volts_frac": design.fits_frac,
    }

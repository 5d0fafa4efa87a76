"""Verdict on a designed plate: the static bound, and what the closed loop gives fingers that move over it.

The search compares plates by what fingers at rest get with exact knowledge. Prediction, noise, the fit of the mode map,
and strokes that start, stop and pass places where modes reach their limits take away from it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from ..config.sections import CONTRAST, FELT, OBJECTIVES, Config, SolverConfig
from ..design.contact_search import ENOUGH_SLIP_FRAC, ContactDesign, Drive, Plate
from ..design.materials import MATERIALS
from ..sim.fingers.strokes import Strokes
from ..sim.score import CONTACT_RADIUS_MM
from . import plate_files

SCENARIO, SEED = "strokes", 1  # and its own length, so that `simulate strokes` prints the same figures
HOW = "in the closed loop of `hapticd simulate strokes`"
ENOUGH_CONTRAST = 12.0  # of RMS: a still contact of 0.08 um when the other slips by 1 um, below what is felt
ENOUGH_MOVING_FRAC = 2.0 / 3.0  # of the target: friction is then 0.4 of bare glass. Strokes cost a tenth of the bound


@dataclass(frozen=True, slots=True)
class Motion:
    """RMS amplitudes over the contacts of a slipping and a still finger by the objective "contrast", and the share of
    time in which both feel what was asked by "felt"."""

    slip_um: float
    still_um: float
    felt_frac: float

    @property
    def contrast(self) -> float:
        """Their ratio."""
        return math.inf if self.still_um == 0.0 else self.slip_um / self.still_um


def simulate(design: ContactDesign, drive: Drive, progress: Callable[[float], None] = lambda _: None) -> Motion:
    """Return what fingers get in the closed loop. Raises ValueError with the reason why this cannot be simulated."""
    from ..sim import lockstep
    from ..sim.plate.ground_truth import PlateSettings

    if drive.radius_mm != CONTACT_RADIUS_MM:
        raise ValueError(f"simulated contacts have a radius of {CONTACT_RADIUS_MM:g} mm")
    edge_mm = 2.0 * Strokes.half_size_mm
    if min(design.plate.size_mm) < edge_mm:
        raise ValueError(f"simulated strokes need a plate of {edge_mm:g} x {edge_mm:g} mm or more")
    lines = plate_files.glass_lines(design, drive)
    with TemporaryDirectory(prefix="hapticd-") as folder:
        path = Path(folder) / "plate.toml"
        path.write_text("\n".join(lines), encoding="utf-8")
        plate = replace(PlateSettings.of(str(path)), q_factor=drive.q_factor)
        scores = {}
        for played, objective in enumerate(OBJECTIVES):
            config = Config(solver=replace(SolverConfig(), objective=objective))
            settings = lockstep.Settings(plate=plate, config=config)
            scores[objective] = lockstep.run(
                SCENARIO, settings=settings, seed=SEED, progress=partial(_of_all, progress, played)
            ).score
    most = scores[CONTRAST]
    return Motion(most.contact_slip_um, most.contact_leak_um, scores[FELT].felt_frac)


def _of_all(progress: Callable[[float], None], played: int, share: float) -> None:
    progress((played + share) / len(OBJECTIVES))


def verdict(design: ContactDesign, drive: Drive, motion: Motion | str) -> str:
    """Return what the plate gives fingers at rest and in motion, and whether the latter is enough.

    `motion` is a reason where that is unknown; then the static bound is judged.
    """
    bound = (
        f"{_plate_name(design.plate)}, driven at {design.drive_hz:g} Hz with {len(design.shapes)} modes "
        f"({', '.join(shape.name for shape in design.shapes)}). Static bound, for fingers at rest: a slipping contact "
        f"gets {design.slip_um:.2f} um, a still one {design.still_um:.3f} um, a contrast of {design.contrast:.1f}. "
    )
    if isinstance(motion, str):
        enough_um = ENOUGH_SLIP_FRAC * drive.target_um
        judged = _judged(design.contrast, design.slip_um, enough_um)
        return f"{bound}In motion: not simulated, as {motion}. The static bound is {judged}."
    judged = _judged(motion.contrast, motion.slip_um, ENOUGH_MOVING_FRAC * drive.target_um)
    return (
        f"{bound}In motion, {HOW}: both feel what was asked in {motion.felt_frac:.0%} of the time, or with "
        f"`--objective {CONTRAST}` {motion.slip_um:.2f} um, {motion.still_um:.3f} um, a contrast of "
        f"{motion.contrast:.1f}: {judged}."
    )


def _judged(contrast: float, slip_um: float, enough_um: float) -> str:
    lacks = []
    if not contrast >= ENOUGH_CONTRAST:
        lacks.append(f"less than a contrast of {ENOUGH_CONTRAST:g}")
    if not slip_um >= enough_um:
        lacks.append(f"less than {enough_um:.2f} um of slip")
    return f"not enough for whole fingertips ({' and '.join(lacks)})" if lacks else "enough for whole fingertips"


def _plate_name(plate: Plate) -> str:
    width_mm, depth_mm = plate.size_mm
    of = plate.material
    name = next((name for name, known in MATERIALS.items() if known == of), f"a material of {of.young_gpa:g} GPa")
    glued = f" with {len(plate.patches)} patches" if plate.patches else ""
    return f"{width_mm:g} x {depth_mm:g} x {plate.thickness_mm:g} mm of {name}{glued}"

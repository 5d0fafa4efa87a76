"""Verdict on a designed plate: what fingers at rest feel, and what the closed loop gives fingers that move over it.

The search compares plates by what fingers at rest get with exact knowledge. Prediction, noise, the fit of the mode map,
and strokes that start, stop and pass places where modes reach their limits take away from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..config.sections import Config, PlateConfig
from ..design.felt_search import FeltDesign
from ..design.felt_tolerances import CALIPER_MM, YOUNG_FRAC, Tolerances
from ..design.glued_plate import GluedPlate
from ..design.materials import MATERIALS
from ..design.mode_choice import FeltTask
from ..design.plate_bounds import Bound
from ..sim.fingers.strokes import HALF_SIZE_MM
from ..sim.plate.glasses import FARTHEST_HZ
from ..sim.score import CONTACT_RADIUS_MM
from . import plate_files

if TYPE_CHECKING:
    from ..sim.settings import Settings

SCENARIO, SEED = "strokes", 1  # and its own length, so that `simulate strokes` prints the same figures
HOW = "in the closed loop of `hapticd simulate strokes --motion smooth`"
ENOUGH_FELT, ENOUGH_FELT_AT_REST = 0.85, 0.95  # of the time and of the places; motion costs about a tenth


class FeltMotion(NamedTuple):
    """Shares of the time in which all fingers, and each, feel what was asked in the closed loop, and in which the
    motion takes no more than the patches' volts; RMS amplitudes over the contacts of fingers that slip and that are
    still, NaN where there are none."""

    felt_frac: float
    each_frac: tuple[float, ...]
    within_volts_frac: float
    slip_um: float
    still_um: float


def simulate_felt(
    design: FeltDesign, task: FeltTask, person: PlateConfig, progress: Callable[[float], None]
) -> FeltMotion:
    """Return what two fingers with this person's friction feel in the closed loop. Raises ValueError with the reason
    why this cannot be simulated."""
    from ..sim import lockstep
    from ..sim.fingers.scenarios import SCENARIOS, strokes

    if len(task.targets_um) != 2:
        raise ValueError("simulated strokes have two fingers")
    played = replace(SCENARIOS[SCENARIO], build=partial(strokes, targets_um=task.targets_um))
    with _file_of(design, task.radius_mm, design.reach_um) as path:
        settings = _settings(path, task.q_factor, person)
        run = lockstep.run(played, settings=settings, seed=SEED, progress=progress)
    rates_um_s = np.gradient(run.modal_um, run.t_s, axis=0)
    patch_v = design.driven.patch_volts_v(run.modal_um.T, design.drive_hz, rates_um_s.T)
    within = np.all(patch_v <= design.driven.most_v[:, None], axis=0)
    each = tuple(finger.felt_frac for finger in run.score.fingers)
    score = run.score
    return FeltMotion(score.felt_frac, each, float(np.mean(within)), score.contact_slip_um, score.contact_leak_um)


@contextmanager
def _file_of(design: FeltDesign, radius_mm: float, reach_um: tuple[float, ...]) -> Iterator[Path]:
    """Write the plate's file for as long as it is simulated. Raises ValueError."""
    if radius_mm != CONTACT_RADIUS_MM:
        raise ValueError(f"simulated contacts have a radius of {CONTACT_RADIUS_MM:g} mm")
    edge_mm = 2.0 * HALF_SIZE_MM
    if min(design.plate.size_mm) < edge_mm:
        raise ValueError(f"simulated strokes need a plate of {edge_mm:g} x {edge_mm:g} mm or more")
    lines = plate_files.glass_lines(design, reach_um)
    with TemporaryDirectory(prefix="hapticd-") as folder:
        path = Path(folder) / "plate.toml"
        path.write_text("\n".join(lines), encoding="utf-8")
        yield path


def _settings(path: Path, q_factor: float, person: PlateConfig) -> Settings:
    from ..sim.plate.ground_truth import PlateSettings
    from ..sim.settings import Settings

    plate = replace(PlateSettings.of(str(path)), q_factor=q_factor)
    felt = PlateConfig(
        friction_curve=person.friction_curve,
        friction_floor_frac=person.friction_floor_frac,
        friction_speed_mm_s=person.friction_speed_mm_s,
    )
    return Settings(plate=plate, config=Config(plate=felt))


def felt_verdict(
    design: FeltDesign, asked: Sequence[Bound], motion: FeltMotion | str, study: Tolerances | None = None
) -> list[str]:
    """Return a line for each figure of a plate with its patches, and at last the verdict."""
    lines = [
        f"friction as asked, at rest: {design.felt_frac:.0%} of places within the patches' volts (computed; "
        f"{len(design.patch_v)} random places, each finger {_percents(design.each_frac)})"
    ]
    if isinstance(motion, str):
        lines.append(f"friction as asked, in motion: not simulated, as {motion}")
        lacks = [] if design.felt_frac >= ENOUGH_FELT_AT_REST else [f"less than {ENOUGH_FELT_AT_REST:.0%} at rest"]
    else:
        lines.append(
            f"friction as asked, in motion: {motion.felt_frac:.0%} of the time {HOW} (simulated; each finger "
            f"{_percents(motion.each_frac)}; within the patches' volts {motion.within_volts_frac:.0%} of the time)"
        )
        if motion.still_um > 0.0 and motion.slip_um > 0.0:
            lines.append(
                f"contrast, in motion: {motion.slip_um / motion.still_um:.1f} (simulated; RMS over contacts: slipping "
                f"{motion.slip_um:.2f} um, still {motion.still_um:.3f} um)"
            )
        lacks = [] if motion.felt_frac >= ENOUGH_FELT else [f"less than {ENOUGH_FELT:.0%} in motion"]
    if study is not None:
        nominal_frac, tenth_frac = study.nominal_frac, study.tenth_frac
        lines.append(
            f"tolerances: as drawn {nominal_frac:.0%} of places at rest; of {len(study.felt_frac)} copies nine in ten "
            f"{tenth_frac:.0%} or more, {tenth_frac / max(nominal_frac, 1e-9):.2f} of that (computed; thickness 0.2 "
            "mm, edges cut to it within 0.1 mm, modulus 2 %, patches 0.5 mm, glue; each scanned and set up)"
        )
    lines += map(str, asked)
    judged = f"not enough friction as asked ({'; '.join(lacks)})" if lacks else "enough friction as asked"
    beyond = [one.name.partition(",")[0] for one in asked if not one.is_kept]
    judged += f", {'and' if lacks else 'but'} beyond its bound: {', '.join(beyond)}" if beyond else ""
    lines += _known_when(design, study)
    lines.append(f"{_plate_name(design.plate)}, driven at {design.drive_hz:.0f} Hz: {judged}.")
    return lines


def _known_when(design: FeltDesign, study: Tolerances | None) -> list[str]:
    """Return what is certain of a plate before it is ordered, and what only its scan decides."""
    families = ", ".join(shape.name for shape in design.shapes)
    least = "what nine in ten copies give: --tolerances 200"
    if study is not None:
        least = f"{study.tenth_frac:.0%} of places or more for nine in ten who order it"
    drive_hz = design.drive_hz
    in_plane = design.plate.in_plane_hz((max(drive_hz - FARTHEST_HZ, 0.0), drive_hz + FARTHEST_HZ))
    away_hz = min((abs(hz - drive_hz) for hz in in_plane), default=FARTHEST_HZ)
    thickness_mm = design.plate.thickness_mm
    off_hz = drive_hz * (YOUNG_FRAC / 2.0 + CALIPER_MM / thickness_mm)
    times = " and ".join(f"{mm / thickness_mm:.4g}" for mm in dict.fromkeys(design.plate.size_mm))
    return [
        f"certain before the order: edges of {times} times the sheet's thickness, measured within {CALIPER_MM:g} mm "
        f"before it is cut; where patches are glued, to scale; families of modes such as {families}; {least}",
        f"modes in the plane, which patches move, too: {away_hz:.0f} Hz or more from the drive (computed)",
        f"only the scan decides: frequencies, {off_hz:.0f} Hz to either side of {drive_hz:.0f} x {thickness_mm:g} mm / "
        "thickness, and which modes near the drive are used (`hapticd calibrate modes`)",
    ]


def _percents(shares: Sequence[float]) -> str:
    return ", ".join(f"{share:.0%}" for share in shares)


def _plate_name(plate: GluedPlate) -> str:
    width_mm, depth_mm = plate.size_mm
    of = plate.material
    name = next((name for name, known in MATERIALS.items() if known == of), f"a material of {of.young_gpa:g} GPa")
    glued = f" with {len(plate.patches)} patches" if plate.patches else ""
    return f"{width_mm:g} x {depth_mm:g} x {plate.thickness_mm:g} mm of {name}{glued}"

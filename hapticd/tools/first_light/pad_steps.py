"""The last steps: the map of modes and the trackpad, by the steps of `hapticd calibrate`, and the first touch."""

from __future__ import annotations

import argparse

from ...design.commissioning.findings import Diagnosis, Judgement
from ...design.commissioning.pad import judge_pad
from ...errors import HapticdError
from .. import pads
from ..calibrate import folder, modes, trackpad
from ..calibrate.marks import fit_affine, placement
from ..calibrate.verdict import Outcome, Verdict, value_of
from . import pictures
from .bench import Bench
from .step import PageResult, StepPage

MARKS_MM = ((-50.0, -40.0), (50.0, -40.0), (50.0, 40.0), (-50.0, 40.0))
NO_SCAN = (
    "There is no scan yet: scan the modes by a vibrometer, a microphone or added mass (CSV, NPZ or UFF), and start "
    "again with --scan FILE."
)


async def _map(bench: Bench) -> PageResult:
    if not (bench.is_simulated or bench.scan):
        return PageResult(Judgement("", (Diagnosis(NO_SCAN),)))
    options = argparse.Namespace(
        sim=bench.is_simulated,
        scan=bench.scan,
        unit=None,
        size=bench.size,
        own_scale=False,
        seed=1,
        out=bench.out,
        plate=bench.plate.plate if bench.is_simulated else None,
        modes=bench.plate.modes if bench.is_simulated else None,
        wiring=None,
    )
    try:
        modes.check(options)
        found = folder.accepted(modes.run(options))
    except HapticdError as error:
        return PageResult(Judgement("", (Diagnosis(str(error)),)))
    return PageResult(_kept(bench, found))


def _kept(bench: Bench, found: Verdict) -> Judgement:
    """Save a verdict of `hapticd calibrate`, and return it as a judgement: what failed is a finding."""
    folder.save(bench.out, found)
    failed = (Diagnosis(found.sentence),) if found.outcome is Outcome.FAIL else ()
    return Judgement(found.sentence, failed, tuple((one.name, value_of(one)) for one in found.figures))


async def _pad(bench: Bench) -> PageResult:
    device, touched_mm = await bench.person.touch(MARKS_MM)
    try:
        found = fit_affine(touched_mm, MARKS_MM)
    except HapticdError as error:
        return PageResult(Judgement("", (Diagnosis(str(error)),)))
    where = placement(found.plate_from_pad)
    judgement = judge_pad(
        where.rotation_deg,
        where.scale_x,
        where.scale_y,
        found.left_out_rms_mm,
        lies_anyhow=device.get("source") in pads.LIE_ANYHOW,
    )
    if judgement.is_passed:
        folder.save(bench.out, folder.accepted(trackpad.verdict(found, device, is_simulated=bench.is_simulated)))
    return PageResult(judgement)


MAP = StepPage(
    "map",
    "Map of the modes",
    "Scan the plate while each mode vibrates alone at 0.1 um, or lower its frequencies by a grain of wax, and give the "
    "file with --scan.",
    pictures.MAP,
    _map,
)
PAD = StepPage(
    "trackpad",
    "The trackpad",
    "Rest one finger on each of the four marks, in their order.",
    pictures.PAD,
    _pad,
)

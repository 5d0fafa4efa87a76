"""Resonances against the design, the straightness of the chain, interlocks that are pulled, and the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hapticd.design.commissioning.drive import HeldMode, judge_deadman, judge_loop, judge_stop, judge_touch
from hapticd.design.commissioning.findings import Flaw, Judgement, PlateDesign
from hapticd.design.commissioning.plate import judge_limits, judge_matrices, judge_resonance
from hapticd.design.wiring import fit_wiring

from .responses import DESIGN, SENSES, sweeps

FOUND = fit_wiring(sweeps())
HELD = HeldMode(1.0, 1.001, 0.001, 25.0, 24.5)


def causes(judgement: Judgement) -> list[Flaw]:
    return [cause for finding in judgement.findings for cause in finding.causes]


def resonance(design: PlateDesign) -> Judgement:
    return judge_resonance(FOUND.fits, design)


def test_a_plate_like_its_design_passes() -> None:
    assert judge_matrices(FOUND).is_passed
    assert resonance(DESIGN).is_passed


def test_swapped_wires_do_not_pass_as_matrices() -> None:
    assert not judge_matrices(fit_wiring(sweeps(SENSES[::-1]))).is_passed


@pytest.mark.parametrize(
    ("changes", "cause", "wires"),
    [
        ({"decay_1_s": (80.0, 80.0), "gain_um_per_v_s": (7.5, 17.0)}, Flaw.GLUE, (1,)),
        ({"gain_um_per_v_s": (15.0, 7.5)}, Flaw.PATCH_CRACKED, (0,)),
        ({"frequency_hz": (28895.0, 28915.0)}, Flaw.DIMENSIONS, ()),
    ],
)
def test_what_differs_from_the_design_is_named(
    changes: dict[str, tuple[float, float]], cause: Flaw, wires: tuple[int, ...]
) -> None:
    (finding,) = resonance(replace(DESIGN, **changes)).findings
    assert (finding.causes, finding.wires) == ((cause,), wires)


def test_a_cut_off_sensor_is_told_from_a_weak_amplifier() -> None:
    most_um = np.array([1.2, 1.2])
    nothing = np.nan
    assert judge_limits(np.array([[1.0, nothing], [nothing, 0.99]]), most_um).is_passed
    (sensor,) = judge_limits(np.array([[0.8, nothing], [1.0, 1.0]]), most_um).findings
    (amplifier,) = judge_limits(np.array([[0.8, nothing], [0.8, 1.0]]), most_um).findings
    assert (sensor.causes, sensor.wires) == ((Flaw.PREAMPLIFIER_CLIPS,), (0,))
    assert amplifier.causes == (Flaw.SUPPLY_LOW,)


def test_a_dead_man_passes_only_if_the_cable_was_pulled_and_the_board_stopped() -> None:
    assert judge_deadman(is_silent=True, was_pulled=True, is_quiet=True).is_passed
    assert "without keep-alives" in judge_deadman(is_silent=False, was_pulled=False, is_quiet=False).sentence
    assert "was not pulled" in judge_deadman(is_silent=True, was_pulled=False, is_quiet=False).sentence
    assert "did not stop" in judge_deadman(is_silent=True, was_pulled=True, is_quiet=False).sentence


def test_a_stop_passes_only_if_it_ended_the_drive_and_was_logged() -> None:
    assert judge_stop(stopped=True, is_logged=True, drives_again=True).is_passed
    assert causes(judge_stop(stopped=False, is_logged=False, drives_again=True)) == [Flaw.STOP_LINE]
    assert causes(judge_stop(stopped=True, is_logged=False, drives_again=True)) == [Flaw.STOP_LINE]
    assert "after the stop's release" in judge_stop(stopped=True, is_logged=True, drives_again=False).sentence


def test_a_loop_passes_if_all_modes_follow_at_the_volts_of_the_calibration() -> None:
    assert judge_loop([HELD, HELD], "").is_passed
    assert "swings" in judge_loop([HELD], "it swings").sentence
    assert "Mode 0 is at 0.900 um" in judge_loop([replace(HELD, mean_um=0.9)], "").sentence
    assert causes(judge_loop([HELD, replace(HELD, volts_v=40.0)], "")) == [Flaw.PREAMPLIFIER_CLIPS]


def test_a_finger_shows_in_the_volts() -> None:
    assert judge_touch(10.0, 12.0, "").is_passed
    assert not judge_touch(10.0, 10.1, "").is_passed
    assert "it swings" in judge_touch(10.0, 12.0, "it swings").sentence

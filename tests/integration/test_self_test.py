"""The board's self-test before the service drives it: a sound plate, and one with swapped wires."""

from __future__ import annotations

import math

import numpy as np
import pytest
from service import Bench, wait_for

from hapticd.board_values import BoardCalibration, ModeCalibration
from hapticd.files import calibration
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings

pytestmark = pytest.mark.long


def calibrate(bench: Bench) -> None:
    plate = GroundTruth(PlateSettings())
    modes = []
    for mode in range(2):
        frequency_hz = plate.settings.drive_hz + plate.nominal_detuning_rad_s[mode] / (2.0 * math.pi)
        quality = math.pi * frequency_hz / plate.nominal_decay_1_s[mode]
        modes.append(ModeCalibration(mode, frequency_hz, quality, float(plate.nominal_gain_um_per_v_s[mode]), 0.0))
    calibration.save(bench.folder / "plate.toml", BoardCalibration(tuple(modes)))
    bench.configure('[device]\ncalibration_file = "plate.toml"\n')


def test_swapped_wires_keep_the_plate_quiet_and_are_named(bench: Bench) -> None:
    calibrate(bench)
    rig = bench.rig("step", wiring="swapped", record=True)
    service, client = bench.service(), bench.client()
    wait_for(lambda: "refused" in client.status()["board"])
    board = client.status()["board"]
    assert (board["self_test"]["outcome"], board["ready"]) == ("unsafe", False)
    assert "are swapped" in board["refused"]
    assert service.lines_with("self-test:", "are swapped", "restart hapticd")
    assert np.abs(rig.recording()["modal_um"]).max() < 0.7  # what the test itself does, with a tenth of the voltage

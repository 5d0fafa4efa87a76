"""What `hapticd calibrate resonance` finds on a simulated plate: its own fit, to sweeps by the plate's equations.

At each frequency the plate is settled, and each sensor has the noise of the samples that the board averages. On the
fingertip plate the sense matrix then errs by 0.0005, as it does after the firmware's sweeps; unmeasured, by 0.01.
"""

from __future__ import annotations

import math

import numpy as np

from ..board_values import BoardCalibration
from ..design.wiring import AmplifierSweep, fit_wiring
from ..sim.lockstep import TICK_NS
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.settings import Measured

BAND_HZ, BESIDE_HZ, POINTS, DWELL_S, VOLTS_V = 100.0, 50.0, 41, 0.1, 15.0  # the command's defaults


def swept(settings: PlateSettings, seed: int) -> Measured:
    """Return the mode map of `seed`, and the calibration by sweeps whose noise is that of `seed` too."""
    plate, random = GroundTruth(settings), np.random.default_rng([seed, 15])
    band_hz = max(BAND_HZ, float(np.abs(plate.nominal_detuning_rad_s).max()) / (2.0 * math.pi) + BESIDE_HZ)
    frequency_hz = settings.drive_hz + np.linspace(-band_hz, band_hz, POINTS)
    away_rad_s = plate.detuning_rad_s - 2.0 * math.pi * (frequency_hz[:, None] - settings.drive_hz)
    follows_s = -1j / (plate.decay_1_s - 1j * away_rad_s)  # (F, P)
    noise = settings.sensor_noise_um / math.sqrt(DWELL_S / 2.0 * 1e9 / TICK_NS) / VOLTS_V
    sweeps = []
    for amplifier in range(settings.driven_modes):
        response = (follows_s * plate.gain_um_per_v_s[:, amplifier]) @ plate.sensor.T
        parts = random.standard_normal((2, *response.shape))
        sweeps.append(AmplifierSweep(amplifier, frequency_hz, response + noise * (parts[0] + 1j * parts[1])))
    return Measured(plate.measured_mode_map(seed), BoardCalibration(tuple(fit_wiring(sweeps).calibrations())))

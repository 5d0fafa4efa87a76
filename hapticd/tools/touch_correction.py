"""Correction of pad, sensors and map by what a recording of touches shows (`design.touch`)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..board_values import BoardCalibration
from ..config.sections import SIGMAS, Config, TrackpadConfig, UncertaintyConfig
from ..core.plate.mode_shapes import ModeShapes
from ..core.touch.contact_ellipse import LEAST_MM, MOST_MM
from ..daemon.settings import has_contacts, plate_from_pad
from ..design.touch.contacts import KNOWN_MM, contact_sizes, ellipse_law
from ..design.touch.judge import NO_CHANGE, TouchCalibration, calibrate
from ..design.touch.model import LATENCY, Calibration
from ..design.touch.observations import Ticks, Track, Windows, in_sessions, in_windows
from ..errors import CalibrationError
from ..files.recording.header import Header
from ..values import ComplexArray, FloatArray
from .touch_recording import Touched

MOST_SHIFT_S = 0.01  # of the latency; touches count this long after they land and before they lift


class LearnedSizes(NamedTuple):
    """The radius of a contact without a reported ellipse, and the pad's law of ellipses: `ellipse_scale` 0 for none."""

    radius_mm: float
    ellipse_scale: float = 0.0
    ellipse_offset_mm: float = 0.0


def joined(sessions: Mapping[Path, Touched]) -> Touched:
    """Return recordings of several sessions as one, which pad, sensors and drive of the last would have shown.

    Raises CalibrationError for recordings of plates of different modes.
    """
    paths = list(sessions)
    last = sessions[paths[-1]]
    for path, one in sessions.items():
        if one.header.modes.M != last.header.modes.M:
            raise CalibrationError(
                f"{path}: is of a plate of {one.header.modes.M} modes, and {paths[-1]} of {last.header.modes.M}: give "
                "recordings of one plate."
            )
    if len(paths) == 1:
        return last
    ticks, tracks = in_sessions([_as_by(last, one) for one in sessions.values()])
    return last._replace(ticks=ticks, tracks=tracks)


def _as_by(last: Touched, one: Touched) -> tuple[Ticks, list[Track]]:
    """Return what a session shows as if it had been recorded with the settings of the last."""
    (now, now_mm), (pad, pad_mm) = (_pose(each.header.config) for each in (one, last))
    linear = pad @ np.linalg.inv(now)
    origin_mm = pad_mm - linear @ now_mm
    late_s = 1e-3 * (one.header.config.trackpad.latency_ms - last.header.config.trackpad.latency_ms)
    tracks = [
        replace(
            track,
            t_s=track.t_s + late_s,
            xy_mm=track.xy_mm @ linear.T + origin_mm,
            velocity_mm_s=track.velocity_mm_s @ linear.T,
        )
        for track in one.tracks
    ]
    ticks, seen = one.ticks, (_sense_of(last.header) @ np.linalg.inv(_sense_of(one.header))).T
    return replace(
        ticks,
        measured_um=ticks.measured_um @ seen,
        slope_um_s=ticks.slope_um_s @ seen,
        behind_um_s=ticks.behind_um_s @ seen,
        turning_rad_s=ticks.turning_rad_s + 2.0 * np.pi * (one.drive_hz - last.drive_hz),
    ), tracks


def _pose(config: Config) -> tuple[FloatArray, FloatArray]:
    """Return the matrix (2, 2) and the offset (2,) in mm from the pad to the plate."""
    pose = plate_from_pad(config)
    return np.array(((pose.xx, pose.xy), (pose.yx, pose.yy))), np.array((pose.offset_x_mm, pose.offset_y_mm))


def _sense_of(header: Header) -> ComplexArray:
    """Return each sensor's weight in each mode (M, M); a mode that is not calibrated has its own alone."""
    own = np.eye(header.modes.M)
    known = {one.mode: one.sense for one in header.calibration.modes}
    return np.array([known.get(mode) or own[mode] for mode in range(header.modes.M)], np.complex128)


def windows_of(touched: Touched) -> Windows:
    """Return the windows in which a recording shows fingers."""
    return in_windows(touched.ticks, touched.tracks, MOST_SHIFT_S)


def judged_by(touched: Touched) -> TouchCalibration:
    """Fit and judge what a recording shows."""
    return calibrate(windows_of(touched), touched.header.modes, touched.header.parasitic_modes)


def pad_settings(touched: Touched, found: Calibration) -> dict[str, Any]:
    """Return the pad's pose and latency: those of the recording, corrected."""
    linear, offset_mm = found.affine
    pad, pad_mm = _pose(touched.header.config)
    latency_ms = touched.header.config.trackpad.latency_ms + 1e3 * float(found.pad[LATENCY])
    (bounds,) = (entry.metadata for entry in fields(TrackpadConfig) if entry.name == "latency_ms")
    return {
        "matrix": [round(value, 6) for value in (linear @ pad).ravel().tolist()],
        "offset_mm": [round(value, 4) for value in (linear @ pad_mm + offset_mm).tolist()],
        "latency_ms": round(min(max(latency_ms, bounds["low"]), bounds["high"]), 3),
    }


def learned_contacts(touched: Touched, judged: TouchCalibration) -> LearnedSizes | None:
    """Return what touches tell of the fingers' size, where contacts count: the law of the pad's ellipses, if it reports
    any, and the mean radius, which stands for fingers without one."""
    config, modes = touched.header.config, touched.header.modes
    if judged.fit is None or judged.refusal not in ("", NO_CHANGE) or not has_contacts(config):
        return None
    sizes = contact_sizes(judged.fit, modes)
    radius_mm, sigma_mm = sizes.mean_mm()
    if sigma_mm > KNOWN_MM or not LEAST_MM < radius_mm < MOST_MM:
        return None
    law = ellipse_law(sizes, np.array([track.axis_mm for track in touched.tracks]))
    if law is None:
        return LearnedSizes(round(radius_mm, 2))
    return LearnedSizes(round(radius_mm, 2), round(law.scale, 4), round(law.offset_mm, 4))


def contact_settings(touched: Touched, judged: TouchCalibration) -> dict[str, dict[str, Any]]:
    """Return the sizes of contacts that touches tell, as settings."""
    sizes = learned_contacts(touched, judged)
    if sizes is None:
        return {}
    found = {"solver": {"contact_radius_mm": sizes.radius_mm}}
    if sizes.ellipse_scale > 0.0:
        found["trackpad"] = {"ellipse_scale": sizes.ellipse_scale, "ellipse_offset_mm": sizes.ellipse_offset_mm}
    return found


def calibration_of(touched: Touched, judged: TouchCalibration) -> BoardCalibration:
    """Return the recording's calibration with corrected sensors; a mode that it lacks cannot have any."""
    known = {one.mode: one for one in touched.header.calibration.modes}
    sense = judged.calibration.sense @ _sense_of(touched.header)
    corrected = [replace(one, sense=tuple(map(complex, sense[mode]))) for mode, one in sorted(known.items())]
    return replace(touched.header.calibration, modes=tuple(corrected))


def has_sensors(touched: Touched) -> bool:
    """Return whether the recording has a calibration of all modes, whose sensors can be corrected.

    The fit has rates and gains too, but too small ones where fingers move slowly: no board gets models of them.
    """
    return len(touched.header.calibration.modes) == touched.header.modes.M


def known_better(touched: Touched, judged: TouchCalibration) -> dict[str, Any]:
    """Return what is not known of map and sensors with what is adopted, as settings, where that is less than the
    recording's: without the map its errors pass for the sensors', nothing is known better, and references get room.

    The map makes up for the sensors' gains, which touches do not tell: they count apart, as in any laboratory, but
    references do not get less room in the mode of the largest limit than they had.
    """
    config = touched.header.config
    before, limits_um = config.uncertainty, config.limits.w_limit_um
    if judged.waves is None:
        return _room_for_other_modes(touched, judged)
    better: dict[str, Any] = {}
    if judged.map_sigma is not None:
        better["map_frac"] = min(before.map_frac, round(float(np.sqrt(np.mean(judged.map_sigma**2))), 4))
    if not has_sensors(touched):
        return better
    sigma = judged.sigma.sense.ravel()[1:]
    sensors_frac = min(before.sensors_frac, round(float(np.sqrt(np.mean(np.abs(sigma) ** 2))), 4))
    all_over_largest = math.hypot(*limits_um) / max(limits_um)
    before_frac = math.hypot(all_over_largest * before.sensors_frac, before.gain_frac)
    gain_frac = math.sqrt(max(before_frac**2 - (all_over_largest * sensors_frac) ** 2, 0.0))
    gain_frac = min(round(gain_frac, 4), UncertaintyConfig().sensors_frac)
    return better | {"sensors_frac": sensors_frac, "gain_frac": gain_frac}


def _room_for_other_modes(touched: Touched, judged: TouchCalibration) -> dict[str, Any]:
    """Return the room that references get where sensors are corrected without a map: what they seem to see of other
    modes may be modes that are mixed otherwise than in the map, and the sensors right as they were."""
    if judged.refusal or not has_sensors(touched):
        return {}
    limits_um = np.array(touched.header.config.limits.w_limit_um)
    sense = np.abs(judged.calibration.sense)
    others = float(((sense @ limits_um) / limits_um - sense.diagonal()).max())
    gain_frac = round(others / SIGMAS, 4)
    return {"gain_frac": gain_frac} if gain_frac > touched.header.config.uncertainty.gain_frac else {}


def mode_map(modes: ModeShapes, judged: TouchCalibration) -> ModeShapes:
    """Return the map with the waves that it lacked."""
    assert judged.waves is not None
    return ModeShapes(
        modes.x_mm, modes.y_mm, modes.shapes + judged.waves.on_grid(judged.calibration.waves, modes.x_mm, modes.y_mm)
    )

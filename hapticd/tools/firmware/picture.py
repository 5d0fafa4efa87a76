"""A sweep as a picture: amplitude over frequency, and the circle that a resonance draws."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...board_values import SweepPoint
from ...design.resonance import Resonance
from ...errors import ConfigError, DeviceError, reason
from .sweep import responses_um_per_v

CURVE_POINTS = 400


def draw_sweep(points: list[SweepPoint], mode: int, found: Resonance, path: Path) -> None:
    """Draws measured points and fit. Raises DeviceError without matplotlib, ConfigError for a place not writable."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise DeviceError("--plot needs matplotlib: pip install 'hapticd[plot]'.") from None
    f_hz = np.array([point.frequency_hz for point in points])
    y = 1e3 * responses_um_per_v(points, mode)
    curve_hz = np.linspace(f_hz.min(), f_hz.max(), CURVE_POINTS)
    fit = 1e3 * found.response(curve_hz)
    figure = Figure(figsize=(9, 4), layout="constrained")
    FigureCanvasAgg(figure)
    amplitude, circle = figure.subplots(1, 2)
    amplitude.plot(curve_hz, np.abs(fit), label="fit")
    amplitude.plot(f_hz, np.abs(y), ".", label="measured")
    amplitude.axvline(found.frequency_hz, color="grey", linewidth=0.8)
    amplitude.set(xlabel="frequency, Hz", ylabel="amplitude, nm/V")
    amplitude.set_title(f"mode {mode}: {found.frequency_hz:.2f} Hz, Q {found.q_factor:.0f}")
    amplitude.locator_params(axis="x", nbins=5)
    amplitude.legend()
    circle.plot(fit.real, fit.imag)
    circle.plot(y.real, y.imag, ".")
    circle.set(xlabel="in phase, nm/V", ylabel="quadrature, nm/V", aspect="equal")
    circle.set_title(f"residual {100 * found.residual_frac:.2f} %")
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be drawn ({reason(error)}): name a .png in a folder of yours.") from None

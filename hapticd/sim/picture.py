"""A run as a picture in the manner of the paper's figures 10 and 11: modal references and measurements over time,
and what each finger got at its true position. Ours beside the paper's scheme, on the same fingers and axes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..files import plotting
from .fingers.scenarios import STEP_S
from .lockstep import Run
from .score import Score, score

MODE_COLOURS = ("tab:blue", "tab:green")  # as in the paper: blue is mode X, green mode Y
FINGER_COLOURS = ("tab:orange", "tab:red", "tab:purple", "tab:brown")
QUADRATURE_UM = 1.0  # the least that its axis shows
STEP_WINDOW_S = (STEP_S - 0.01, STEP_S + 0.04)


@dataclass(frozen=True, slots=True)
class Film:
    """The part of a run that a picture shows; arrays over T control ticks as in `lockstep.Run`."""

    title: str
    t_s: npt.NDArray[np.float64]
    target_um: npt.NDArray[np.float64]
    reference_um: npt.NDArray[np.complex128]
    modal_um: npt.NDArray[np.complex128]
    truth_um: npt.NDArray[np.complex128]
    score: Score

    @classmethod
    def of(cls, run: Run, title: str) -> Film:
        """A lock-step run as it was judged."""
        return cls(title, run.t_s, run.target_um, run.reference_um, run.modal_um, run.truth_um, run.score)

    def between(self, start_s: float, end_s: float) -> Film:
        """A window of it, judged by itself."""
        part = (self.t_s >= start_s) & (self.t_s < end_s)
        arrays = (
            self.t_s[part],
            self.target_um[part],
            self.reference_um[part],
            self.modal_um[part],
            self.truth_um[part],
        )
        judged = score(arrays[0], arrays[1], arrays[4], arrays[2], np.zeros(len(arrays[0]), dtype=bool))
        return Film(self.title, *arrays, judged)


def draw(films: list[Film], path: Path, *, w_limit_um: float, seconds: float | None = None) -> None:
    """Write a PNG with one column for each film; `seconds` cuts the time axis so that single strokes are seen."""
    figure, axes = _canvas(len(films))
    # Where signs alone decide it stays near 0; two slipping fingers may turn the phase between the modes all round.
    quadrature_um = max(float(np.fmax.reduce(np.abs(f.modal_um.imag), axis=None, initial=QUADRATURE_UM)) for f in films)
    for column, film in enumerate(films):
        _draw_modes(axes[0, column], film, w_limit_um)
        _draw_quadrature(axes[1, column], film, quadrature_um)
        _draw_fingers(axes[2, column], film)
        if seconds is not None:
            start_s = float(film.t_s[0])
            axes[2, column].set_xlim(start_s, min(start_s + seconds, float(film.t_s[-1])))
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")
    plotting.save(figure, path)


def draw_run(run: Run, path: Path) -> None:
    """Write a PNG of one lock-step run; of the step only the moments around it."""
    title = run.scenario if run.settings.scheme == "hapticd" else f"{run.scenario}, the paper's scheme"
    film = Film.of(run, title)
    start_s, end_s = STEP_WINDOW_S
    if run.scenario == "step" and run.t_s[-1] >= end_s:
        film = film.between(start_s, end_s)
    draw([film], path, w_limit_um=max(run.settings.config.limits.w_limit_um))


def _canvas(columns: int) -> tuple[Any, Any]:
    return plotting.subplots(7.0 * columns, 8.0, 3, columns, sharex="col", sharey="row", height_ratios=(2, 1, 2))


def _draw_modes(axis: Any, film: Film, w_limit_um: float) -> None:
    for mode, (name, colour) in enumerate(zip("XY", MODE_COLOURS, strict=True)):
        axis.plot(film.t_s, film.modal_um[:, mode].real, color=colour, lw=1.2, label=f"$W_{{{name}d}}$")
        axis.plot(film.t_s, film.reference_um[:, mode].real, "--", color="black", lw=0.7)
    axis.plot([], [], "--", color="black", lw=0.7, label="references")
    if np.abs(film.reference_um).max(initial=0.0) > 0.5 * w_limit_um:
        for level in (-w_limit_um, w_limit_um):
            axis.axhline(level, color="grey", lw=0.6, ls=":")
    axis.set_title(film.title, loc="left")
    axis.set_ylabel("modal amplitude, µm")
    _legend(axis)


def _draw_quadrature(axis: Any, film: Film, high_um: float) -> None:
    for mode, (name, colour) in enumerate(zip("XY", MODE_COLOURS, strict=True)):
        axis.plot(film.t_s, film.modal_um[:, mode].imag, color=colour, lw=0.9, label=f"$W_{{{name}q}}$")
    axis.set_ylabel("quadrature, µm")
    axis.set_ylim(-high_um, high_um)
    _legend(axis)


def _draw_fingers(axis: Any, film: Film) -> None:
    for finger in range(film.target_um.shape[1]):
        colour = FINGER_COLOURS[finger % len(FINGER_COLOURS)]
        axis.plot(film.t_s, np.abs(film.truth_um[:, finger]), color=colour, lw=1.0, label=f"$|W_{finger + 1}|$")
        axis.plot(film.t_s, film.target_um[:, finger], "--", color=colour, lw=0.8)
    axis.set_ylabel("at the finger, µm")
    axis.set_xlabel("time, s")
    axis.set_title(_told(film.score), loc="left", fontsize="small")
    _legend(axis)


def _legend(axis: Any) -> None:
    """Above the axes, on the right: nothing is hidden. None where there is nothing to tell apart."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize="small", ncols=4, frameon=False, borderpad=0.1
        )


def _told(judged: Score) -> str:
    """What a film is worth, as far as anybody was judged in it."""
    parts = []
    if math.isfinite(judged.leak_um):
        parts.append(f"leak {judged.leak_um * 1e3:.0f} nm RMS")
    if math.isfinite(judged.slip_frac):
        parts.append(f"slip {100 * judged.slip_frac:.0f} % of its target")
    return "    ".join(parts)

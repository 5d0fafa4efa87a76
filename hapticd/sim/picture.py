"""A run as a picture in the manner of the paper's figures 10 and 11: references and amplitudes of the modes over time,
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
FINGER_COLOURS = ("tab:orange", "tab:purple", "tab:red", "tab:brown")
REFERENCE = {"lw": 4.0, "alpha": 0.3, "solid_capstyle": "butt"}  # behind the amplitude that follows it
QUADRATURE_UM = 1.0  # the least that its axis shows
LEAST_UM = 0.1  # likewise, of modes and fingers: a still plate's noise is 0.002 um
STEP_WINDOW_S = (STEP_S - 0.01, STEP_S + 0.04)
INCHES_PER_S = 2.8  # single strokes can be told apart
LEAST_IN, MOST_IN = 7.0, 14.0


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

    @property
    def seconds(self) -> float:
        """Its length."""
        return float(np.ptp(self.t_s)) if len(self.t_s) else 0.0


def draw(
    films: list[Film],
    path: Path,
    *,
    w_limit_um: float,
    seconds: float = MOST_IN / INCHES_PER_S,
    source: str = "",
    link_ms: float | None = None,
) -> None:
    """Write a picture with one column for each film: the first `seconds`, so that single strokes are seen.

    `link_ms` explains how long a target that changes once takes to reach the plate.
    """
    shown_s = min(seconds, max(film.seconds for film in films))
    figure, axes = _canvas(len(films), min(max(INCHES_PER_S * shown_s, LEAST_IN), MOST_IN), source)
    # Where signs alone decide it stays near 0; two slipping fingers may turn the phase between the modes all round.
    quadrature_um = max(float(np.fmax.reduce(np.abs(f.modal_um.imag), axis=None, initial=QUADRATURE_UM)) for f in films)
    for column, film in enumerate(films):
        _draw_modes(axes[0, column], film, w_limit_um)
        _draw_quadrature(axes[1, column], film, quadrature_um)
        _draw_fingers(axes[2, column], film)
        part = f", {shown_s:g} s of {film.seconds:.0f} s" if shown_s < 0.9 * film.seconds else ""
        axes[0, column].set_title(film.title + part, loc="left")
        axes[2, column].set_xlim(film.t_s[0], film.t_s[0] + min(shown_s, film.seconds))
        if link_ms is not None:
            _draw_delay(axes[2, column], film, link_ms)
    for axis in axes[:, 1:].flat:
        axis.set_ylabel("")
    plotting.save(figure, path)


def draw_run(run: Run, path: Path) -> None:
    """Write a picture of one lock-step run: its first seconds, of the step only the moments around it."""
    title = run.scenario if run.settings.scheme == "hapticd" else f"{run.scenario}, the paper's scheme"
    film, link_ms = Film.of(run, title), None
    start_s, end_s = STEP_WINDOW_S
    if run.scenario == "step" and run.t_s[-1] >= end_s:
        film, link_ms = film.between(start_s, end_s), run.settings.link_ms
    limit_um = max(run.settings.config.limits.w_limit_um)
    draw([film], path, w_limit_um=limit_um, source=f"simulated {run.scenario}, seed {run.seed}", link_ms=link_ms)


def _canvas(columns: int, width_in: float, source: str) -> tuple[Any, Any]:
    return plotting.subplots(
        width_in * columns,
        8.0,
        3,
        columns,
        source=source,
        sharex="col",
        sharey="row",
        height_ratios=(2, 1, 2),
    )


def _draw_modes(axis: Any, film: Film, w_limit_um: float) -> None:
    for mode, (name, colour) in enumerate(zip("XY", MODE_COLOURS, strict=True)):
        axis.plot(film.t_s, film.reference_um[:, mode].real, color=colour, **REFERENCE)
        axis.plot(film.t_s, film.modal_um[:, mode].real, color=colour, lw=1.0, label=f"$W_{{{name}d}}$")
    axis.plot([], [], color="grey", label="references", **REFERENCE)
    if np.abs(film.reference_um).max(initial=0.0) > 0.5 * w_limit_um:
        for level in (-w_limit_um, w_limit_um):
            axis.axhline(level, color="grey", lw=0.6, ls=":")
    plotting.show_at_least(axis, -LEAST_UM, LEAST_UM)
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
        axis.plot(film.t_s, np.abs(film.truth_um[:, finger]), color=colour, lw=1.0, label=f"finger {finger + 1}")
        axis.step(film.t_s, film.target_um[:, finger], "--", where="post", color=colour, lw=0.8)
    if np.isfinite(film.target_um).any():
        axis.plot([], [], "--", color="grey", lw=0.8, label="targets")
    else:
        plotting.mark_empty(axis, "no finger has a target")
    plotting.show_at_least(axis, 0.0, LEAST_UM)
    axis.set_ylabel("vibration at the finger, µm")
    axis.set_xlabel("time, s")
    axis.set_title(_told(film), loc="left", fontsize="small")
    _legend(axis)


def _draw_delay(axis: Any, film: Film, link_ms: float) -> None:
    """Mark the time from the change of the first finger's target until the plate moves."""
    target_um, reached_um = film.target_um[:, 0], np.abs(film.truth_um[:, 0])
    asked, moves = int(np.argmax(target_um > 0)), int(np.argmax(reached_um > 0.01 * target_um[-1]))
    t_asked_s, t_moves_s, half_um = film.t_s[asked], film.t_s[moves - 1], target_um[-1] / 2
    axis.annotate(
        "", (t_moves_s, half_um), (t_asked_s, half_um), arrowprops={"arrowstyle": "<->", "shrinkA": 0, "shrinkB": 0}
    )
    told = f"{1e3 * (t_moves_s - t_asked_s):.1f} ms: the link's {link_ms:g} ms,\nand the board's next control period"
    axis.text(t_moves_s + 0.001, half_um, told, va="center", fontsize="small")


def _legend(axis: Any) -> None:
    """Above the axes, on the right: nothing is hidden. None where there is nothing to tell apart."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize="small", ncols=4, frameon=False, borderpad=0.1
        )


def _told(film: Film) -> str:
    """What a film is worth, as far as anybody was judged in it."""
    judged, parts = film.score, []
    if math.isfinite(judged.leak_um):
        parts.append(f"sticky: {judged.leak_um:.3f} µm RMS")
    if math.isfinite(judged.slip_frac):
        parts.append(f"slippery: {100 * judged.slip_frac:.0f} % of the target")
    return ", ".join(parts) + (f" (in {film.seconds:.0f} s)" if parts else "")

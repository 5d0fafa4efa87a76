"""A run as a picture in the manner of the paper's figures 10 and 11: references and amplitudes of the modes over time,
and the vibration at each finger's true position and over its contact."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.friction import DEFAULT_FRICTION_CURVE
from ..sim.fingers.scenarios import STEP_S
from ..sim.lockstep import Run
from ..sim.plate.ground_truth import GroundTruth, PlateSettings
from ..sim.score import CONTACT_RADIUS_MM, Score, felt, score
from ..values import ComplexArray, FloatArray
from . import plotting

# As in the paper: blue is mode X, green mode Y.
MODE_COLOURS = ("tab:blue", "tab:green", "tab:cyan", "tab:olive", "tab:pink", "tab:gray", "tab:brown", "tab:red")
FINGER_COLOURS = ("tab:orange", "tab:purple", "tab:red", "tab:brown")
REFERENCE = {"lw": 4.0, "alpha": 0.3, "solid_capstyle": "butt"}  # behind the amplitude that follows it
CENTRE = {"lw": 0.6, "alpha": 0.5}  # behind the contact's RMS
TITLE_PT = 18.0  # titles stand above the legends
QUADRATURE_UM = 1.0  # the least that its axis shows
LEAST_UM = 0.1  # likewise, of modes and fingers: a still plate's noise is 0.002 um
STEP_WINDOW_S = (STEP_S - 0.01, STEP_S + 0.04)
INCHES_PER_S = 2.8  # single strokes stay distinct
LEAST_IN, MOST_IN = 7.0, 14.0
CONTACT_EVERY = 8  # ticks: 4 ms, in which a finger moves 0.4 mm
_ARRAYS = ("t_s", "finger_true_mm", "target_um", "reference_um", "modal_um", "plate_um", "truth_um")


@dataclass(frozen=True, slots=True)
class Film:
    """The part of a run that a picture shows; arrays over T control ticks as in `lockstep.Run`."""

    title: str
    plate: PlateSettings
    t_s: FloatArray
    finger_true_mm: FloatArray
    target_um: FloatArray
    reference_um: ComplexArray
    modal_um: ComplexArray
    plate_um: ComplexArray
    truth_um: ComplexArray
    score: Score

    @classmethod
    def of(cls, run: Run, title: str) -> Film:
        """A lock-step run as it was judged."""
        return cls(title, run.settings.plate, score=run.score, **{name: getattr(run, name) for name in _ARRAYS})

    @classmethod
    def judged(cls, title: str, plate: PlateSettings, arrays: Mapping[str, Any]) -> Film:
        """Arrays on a plate, judged by themselves."""
        own = {name: arrays[name] for name in _ARRAYS}
        judged = score(
            *(own["t_s"], own["finger_true_mm"], own["target_um"], own["truth_um"], own["plate_um"]),
            GroundTruth(plate).shapes,
            limited=np.zeros(len(own["t_s"]), dtype=bool),
            every=CONTACT_EVERY,
            reference_um=own["reference_um"],
        )
        return cls(title, plate, score=judged, **own)

    def between(self, start_s: float, end_s: float) -> Film:
        """A window of it, judged by itself."""
        part = (self.t_s >= start_s) & (self.t_s < end_s)
        return Film.judged(self.title, self.plate, {name: getattr(self, name)[part] for name in _ARRAYS})

    def contacts(self, seconds: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return instants of the first `seconds` (T',), then over each contact (T',N) the RMS amplitude, the friction
        relative to bare glass, by the built-in curve, and the friction that was asked."""
        part = slice(None, int(np.searchsorted(self.t_s, self.t_s[0] + seconds)), CONTACT_EVERY)
        rms_um, got = felt(self.finger_true_mm[part], self.plate_um[part], GroundTruth(self.plate).shapes)
        asked = DEFAULT_FRICTION_CURVE.frictions(self.target_um[part], np.zeros_like(got))
        return self.t_s[part], rms_um, got, asked

    def field_um(self, index: int, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return the plate's amplitude on a grid (Y, X) at one instant."""
        points_mm = np.stack(np.meshgrid(x_mm, y_mm), axis=-1)
        return np.asarray(np.abs(GroundTruth(self.plate).shapes(points_mm) @ self.plate_um[index]))

    @property
    def seconds(self) -> float:
        return float(np.ptp(self.t_s)) if len(self.t_s) else 0.0


def draw_run(run: Run, path: Path) -> None:
    """Write a picture of one lock-step run: its first seconds, so that single strokes are seen, of the step only the
    moments around it; of each finger the RMS over its contact, and the amplitude at its centre behind it."""
    film = Film.of(run, run.scenario)
    if run.scenario == "step" and run.t_s[-1] >= STEP_WINDOW_S[1]:
        film = film.between(*STEP_WINDOW_S)
    shown_s = min(MOST_IN / INCHES_PER_S, film.seconds)
    width_in = min(max(INCHES_PER_S * shown_s, LEAST_IN), MOST_IN)
    source = f"simulated {run.scenario}, seed {run.seed}"
    figure, axes = plotting.subplots(width_in, 8.0, 3, source=source, sharex="col", height_ratios=(2, 1, 2))
    modes, quadrature, fingers = axes[:, 0]
    _draw_modes(modes, film)
    _draw_quadrature(quadrature, film)
    _draw_fingers(fingers, film, shown_s)
    part = f", {shown_s:g} s of {film.seconds:.0f} s" if shown_s < 0.9 * film.seconds else ""
    modes.set_title(film.title + part, loc="left", pad=TITLE_PT)
    fingers.set_xlim(film.t_s[0], film.t_s[0] + shown_s)
    plotting.save(figure, path)


def _modes(film: Film) -> list[tuple[str, str]]:
    """Return name and colour of each driven mode: the letters of the paper, numbers where there are more."""
    count = film.modal_um.shape[1]
    names = "XYZ" if count <= 3 else "12345678"
    return list(zip(names[:count], MODE_COLOURS[:count], strict=True))


def _draw_modes(axis: Any, film: Film) -> None:
    w_limit_um = max(GroundTruth(film.plate).w_limit_um)
    for mode, (name, colour) in enumerate(_modes(film)):
        axis.plot(film.t_s, film.reference_um[:, mode].real, color=colour, **REFERENCE)
        axis.plot(film.t_s, film.modal_um[:, mode].real, color=colour, lw=1.0, label=f"$W_{{{name}d}}$")
    axis.plot([], [], color="grey", label="references", **REFERENCE)
    if np.abs(film.reference_um).max(initial=0.0) > 0.5 * w_limit_um:
        for level in (-w_limit_um, w_limit_um):
            axis.axhline(level, color="grey", lw=0.6, ls=":")
    plotting.show_at_least(axis, -LEAST_UM, LEAST_UM)
    axis.set_ylabel("modal amplitude, µm")
    _legend(axis)


def _draw_quadrature(axis: Any, film: Film) -> None:
    for mode, (name, colour) in enumerate(_modes(film)):
        axis.plot(film.t_s, film.modal_um[:, mode].imag, color=colour, lw=0.9, label=f"$W_{{{name}q}}$")
    # Where signs alone decide it stays near 0; two slipping fingers may turn the phase between the modes all round.
    high_um = float(np.fmax.reduce(np.abs(film.modal_um.imag), axis=None, initial=QUADRATURE_UM))
    axis.set_ylabel("quadrature, µm")
    axis.set_ylim(-1.05 * high_um, 1.05 * high_um)
    _legend(axis)


def _draw_fingers(axis: Any, film: Film, shown_s: float) -> None:
    t_contact_s, contacts_um, _, _ = film.contacts(shown_s)
    for finger in range(film.target_um.shape[1]):
        colour, name = FINGER_COLOURS[finger % len(FINGER_COLOURS)], f"finger {finger + 1}"
        axis.plot(film.t_s, np.abs(film.truth_um[:, finger]), color=colour, **CENTRE)
        axis.plot(t_contact_s, contacts_um[:, finger], color=colour, lw=1.6, label=name)
        axis.step(film.t_s, film.target_um[:, finger], "--", where="post", color=colour, lw=0.8)
    axis.plot([], [], color="grey", label="at its centre", **CENTRE)
    if np.isfinite(film.target_um).any():
        axis.plot([], [], "--", color="grey", lw=0.8, label="targets")
    else:
        plotting.mark_empty(axis, "no finger has a target")
    plotting.show_at_least(axis, 0.0, LEAST_UM)
    axis.set_ylabel("vibration over the contact, µm RMS")
    axis.set_xlabel("time, s")
    if math.isfinite(film.score.contrast):
        caption = f"over {CONTACT_RADIUS_MM:g} mm: sticky {film.score.contact_leak_um:.2f} µm RMS, "
        caption += f"slippery {film.score.contact_slip_um:.2f}; contrast {film.score.contrast:.1f} "
        caption += f"(in {film.seconds:.0f} s; sticky centre {film.score.leak_um:.3f})"
        axis.set_title(caption, loc="left", fontsize="small", pad=TITLE_PT)
    _legend(axis)


def _legend(axis: Any) -> None:
    """Above the axes, on the right: nothing is hidden. None where there is nothing to tell apart."""
    handles = axis.get_legend_handles_labels()[0]
    if handles:
        style = {"fontsize": "small", "frameon": False, "borderpad": 0.1, "handlelength": 1.4, "columnspacing": 1.2}
        axis.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(handles), **style)

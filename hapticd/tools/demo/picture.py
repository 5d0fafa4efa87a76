"""The demo's picture: the plate from above at one instant, and the friction that both fingers feel over time in each
column of the comparison, with the band of just noticeable differences around what was asked.

A finger's friction is the mean over its contact, a disc. The instant is the one at which both fingers feel what is most
typical of the run.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...sim.plate.glasses import find_glass
from ...sim.score import CONTACT_RADIUS_MM
from ...values import WEBER_FRAC
from .. import plotting
from .film import Film

SLIPPERY, STICKY = "#0b6fa4", "#b3500c"  # as in the browser's page
ON_FIELD = {SLIPPERY: "#8fd3ff", STICKY: "#ffb877"}  # the same, legible on dark colours
WIDTH_IN, HEIGHT_IN = 13.2, 5.8
POINTS, LEVELS, COLOURS = 241, 48, 160
TICKS_UM = (0.0, 0.1, 0.5, 1.0, 2.0, 4.0, 8.0)
FRICTIONS = (0.2, 0.5, 1.0)  # on an axis on which equal differences are equally noticeable
LEAST, MOST = 0.14, 1.25
LABEL_MM = 13.0  # from a contact's centre to its label
BOX = {"boxstyle": "round,pad=0.3", "fc": "#14181bd0", "ec": "none"}


def draw(films: list[Film], path: Path, *, seconds: float, source: str) -> None:
    """Write the picture of the first `seconds` of runs of the same fingers; the plate is the last one's.

    Raises HapticdError.
    """
    figure, axes = plotting.subplots(WIDTH_IN, HEIGHT_IN, len(films), 2, source=source, width_ratios=(1.05, 1.35))
    grid = axes[0, 0].get_gridspec()
    for axis in axes[:, 0]:
        axis.remove()
    _draw_plate(figure, figure.add_subplot(grid[:, 0]), films[-1], seconds)
    for axis, film in zip(axes[:, 1], films, strict=True):
        _draw_time(axis, film, seconds)
        axis.tick_params(labelbottom=False)
    axes[-1, 1].tick_params(labelbottom=True)
    axes[-1, 1].set_xlabel("time, s")
    plotting.save(figure, path, colours=COLOURS)


def typical_instant(film: Film, seconds: float) -> int:
    """Return the index of the instant at which both contacts' frictions are nearest to their medians over the run."""
    t_s, got, _ = film.contacts(seconds)
    is_complete = np.isfinite(got).all(axis=1)
    if not is_complete.any():
        return 0
    off = np.abs(np.log(got / np.median(got[is_complete], axis=0))).sum(axis=1)
    return int(np.searchsorted(film.t_s, t_s[int(np.argmin(np.where(is_complete, off, np.inf)))]))


def _draw_plate(figure: Any, axis: Any, film: Film, seconds: float) -> None:
    from matplotlib.colors import PowerNorm
    from matplotlib.patches import Circle

    at = typical_instant(film, seconds)
    width_mm, depth_mm = find_glass(film.plate.plate).size_mm
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, POINTS) for edge_mm in (width_mm, depth_mm))
    image = axis.imshow(
        film.field_um(at, x_mm, y_mm),
        origin="lower",
        extent=(-width_mm / 2, width_mm / 2, -depth_mm / 2, depth_mm / 2),
        cmap=plotting.stepped("viridis", LEVELS),
        norm=PowerNorm(0.5, vmin=0.0),  # small amplitudes matter as much as large ones
    )
    instants_s, *frictions = film.contacts(seconds)
    felt, target = (each[int(np.searchsorted(instants_s, film.t_s[at]))] for each in frictions)
    for finger, (place_mm, got, asked) in enumerate(zip(film.finger_true_mm[at], felt, target, strict=True)):
        if not np.isfinite(asked):
            continue
        colour = ON_FIELD[_colour(asked)]
        for edge, width in (("black", 5.0), (colour, 2.6)):
            axis.add_patch(Circle(place_mm, CONTACT_RADIUS_MM, fill=False, ec=edge, lw=width))
        is_above = place_mm[1] >= np.nanmax(film.finger_true_mm[at][:, 1]) and place_mm[1] < depth_mm / 2 - 2 * LABEL_MM
        away_mm = LABEL_MM if is_above else -LABEL_MM  # of two fingers one above and one below: apart
        axis.text(
            np.clip(place_mm[0], -0.23 * width_mm, 0.23 * width_mm),
            place_mm[1] + away_mm,
            f"finger {finger + 1}: asked {asked:.2f}, feels {got:.2f}",
            color=colour,
            weight="bold",
            fontsize=9,
            ha="center",
            va="top" if away_mm < 0 else "bottom",
            bbox=BOX,
        )
    axis.set(xticks=(), yticks=())
    scheme, _, plate = film.title.partition(", ")
    axis.set_title(f"{scheme}: two fingers on one plate", loc="left", fontsize=12, weight="bold")
    axis.set_title(plate, loc="right", fontsize=9)
    axis.set_xlabel(
        f"from above, at {film.t_s[at] - film.t_s[0]:.2f} s: bright glass moves and is slippery, dark glass is still"
    )
    bar = {"location": "left", "shrink": 0.8, "aspect": 40, "ticks": TICKS_UM}
    figure.colorbar(image, ax=axis, label="vibration, µm peak to peak", **bar)


def _draw_time(axis: Any, film: Film, seconds: float) -> None:
    t_s, got, asked = film.contacts(seconds)
    t_s = t_s - film.t_s[0]  # windows of different runs, over one axis
    for finger in range(asked.shape[1]):
        known = asked[np.isfinite(asked[:, finger]), finger]
        if not len(known):
            continue
        colour = _colour(known[-1])
        band = [asked[:, finger] * (1.0 + side * WEBER_FRAC) for side in (-1.0, 1.0)]
        axis.fill_between(t_s, *band, color=colour, alpha=0.25, lw=0.0)
        axis.plot(t_s, got[:, finger], color=colour, lw=2.0)
        label = f"finger {finger + 1},\nasked {known[-1]:.2g}" + (":\nbare glass" if known[-1] == 1.0 else "")
        axis.annotate(label, (1.01, known[-1]), xycoords=("axes fraction", "data"), color=colour, va="center")
    judged = film.score
    scheme, _, plate = film.title.partition(", ")
    if np.isfinite(judged.felt_frac):
        scheme += f": as asked {judged.felt_frac:.0%} of the time"
    axis.set_title(scheme, loc="left", fontsize=12, weight="bold")
    axis.set_title(plate, loc="right", fontsize=9)
    axis.set_xlim(0.0, min(seconds, film.seconds))
    axis.set(yscale="log", ylim=(LEAST, MOST), ylabel="friction")
    axis.set_yticks(FRICTIONS, [f"{friction:g}" for friction in FRICTIONS])
    axis.minorticks_off()


def _colour(asked: float) -> str:
    return STICKY if asked == 1.0 else SLIPPERY

"""The demo's picture: the plate from above at one instant, and what both fingers feel over time under two schemes.

A finger's amplitude is the RMS over its contact, a disc. The instant is the one at which both fingers get what is most
typical of the run.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ...files import plotting
from ...sim.picture import Film
from ...sim.plate.glasses import find_glass
from ...sim.score import CONTACT_RADIUS_MM

SLIPPERY, STICKY = "#0b6fa4", "#b3500c"  # as in the browser's page
ON_FIELD = {SLIPPERY: "#8fd3ff", STICKY: "#ffb877"}  # the same, legible on dark colours
WIDTH_IN, HEIGHT_IN = 13.2, 5.2
POINTS, LEVELS, COLOURS = 241, 48, 160
TICKS_UM = (0.0, 0.1, 0.5, 1.0, 2.0, 4.0, 8.0)
LEAST_UM = 0.001
LABEL_MM = 13.0  # from a contact's centre to its label
BOX = {"boxstyle": "round,pad=0.3", "fc": "#14181bd0", "ec": "none"}


def draw(paper: Film, ours: Film, path: Path, *, seconds: float, source: str) -> None:
    """Write the picture of the first `seconds` of two runs of the same fingers. Raises HapticdError."""
    figure, axes = plotting.subplots(WIDTH_IN, HEIGHT_IN, 2, 2, source=source, width_ratios=(1.05, 1.35))
    grid = axes[0, 0].get_gridspec()
    for axis in axes[:, 0]:
        axis.remove()
    _draw_plate(figure, figure.add_subplot(grid[:, 0]), ours, seconds)
    highest_um = max(_draw_time(axis, film, seconds) for axis, film in zip(axes[:, 1], (paper, ours), strict=True))
    for axis in axes[:, 1]:
        axis.set_ylim(-0.04 * highest_um, 1.04 * highest_um)
    axes[0, 1].tick_params(labelbottom=False)
    axes[1, 1].set_xlabel("time, s")
    plotting.save(figure, path, colours=COLOURS)


def typical_instant(film: Film, seconds: float) -> int:
    """Return the index of the instant at which both contacts are nearest to their RMS over the run."""
    t_s, contacts_um = film.contacts_um(seconds)
    is_complete = np.isfinite(contacts_um).all(axis=1)
    if not is_complete.any():
        return 0
    usual_um = np.sqrt(np.square(contacts_um[is_complete]).mean(axis=0))
    off = np.abs(np.log(np.maximum(contacts_um, LEAST_UM) / np.maximum(usual_um, LEAST_UM))).sum(axis=1)
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
    contacts_um = film.contacts_at_um(at)
    for finger, (place_mm, asked_um) in enumerate(zip(film.finger_mm[at], film.target_um[at], strict=True)):
        if not np.isfinite(asked_um):
            continue
        colour = ON_FIELD[_colour(asked_um)]
        for edge, width in (("black", 5.0), (colour, 2.6)):
            axis.add_patch(Circle(place_mm, CONTACT_RADIUS_MM, fill=False, ec=edge, lw=width))
        is_above = place_mm[1] >= np.nanmax(film.finger_mm[at][:, 1]) and place_mm[1] < depth_mm / 2 - 2 * LABEL_MM
        away_mm = LABEL_MM if is_above else -LABEL_MM  # of two fingers one above and one below: apart
        axis.text(
            np.clip(place_mm[0], -0.23 * width_mm, 0.23 * width_mm),
            place_mm[1] + away_mm,
            f"finger {finger + 1}: asked {asked_um:g} µm, gets {contacts_um[finger]:.2f}",
            color=colour,
            weight="bold",
            fontsize=9,
            ha="center",
            va="top" if away_mm < 0 else "bottom",
            bbox=BOX,
        )
    axis.set(xticks=(), yticks=())
    axis.set_title("hapticd: two fingers on one plate, from above", loc="left", fontsize=12, weight="bold")
    axis.set_xlabel(f"at {film.t_s[at]:.2f} s; bright glass moves and is slippery, dark glass is still")
    bar = {"location": "left", "shrink": 0.8, "aspect": 40, "ticks": TICKS_UM}
    figure.colorbar(image, ax=axis, label="vibration, µm peak to peak", **bar)


def _draw_time(axis: Any, film: Film, seconds: float) -> float:
    """Draw what each finger gets; return the largest amplitude."""
    t_s, contacts_um = film.contacts_um(seconds)
    asked_um = film.target_um[np.searchsorted(film.t_s, t_s)]
    for finger in range(asked_um.shape[1]):
        known_um = asked_um[np.isfinite(asked_um[:, finger]), finger]
        if not len(known_um):
            continue
        colour = _colour(known_um[-1])
        axis.plot(t_s, contacts_um[:, finger], color=colour, lw=2.0)
        axis.plot(t_s, asked_um[:, finger], "--", color=colour, lw=0.9)
        label = f"finger {finger + 1},\nasked {known_um[-1]:g}"
        axis.annotate(label, (1.01, known_um[-1]), xycoords=("axes fraction", "data"), color=colour, va="center")
    judged = film.score
    scheme, _, plate = film.title.partition(", ")
    if np.isfinite(judged.contrast):
        scheme += f": {judged.contrast:.1f} to 1"
        plate += f": {judged.contact_slip_um:.2f} and {judged.contact_leak_um:.2f} µm"
    axis.set_title(scheme, loc="left", fontsize=12, weight="bold")
    axis.set_title(plate, loc="right", fontsize=9)
    axis.set_xlim(film.t_s[0], film.t_s[0] + min(seconds, film.seconds))
    axis.set_ylabel("what each feels, µm")
    return float(np.nanmax(contacts_um, initial=1.2))


def _colour(asked_um: float) -> str:
    return STICKY if asked_um == 0 else SLIPPERY

"""Draws concept.png of the README: why vibration makes glass slippery, and how two modes serve two fingers.

    python .github/concept.py .github/concept.png

Modes, amplitudes and vibration are those of the simulated plate; the section on the left is a drawing, not to scale.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

from hapticd.core.solver import solve
from hapticd.design import free_plate_modes
from hapticd.sim.plate.ground_truth import DRIVEN_MODES
from hapticd.tools import plotting

HALF_MM, POINTS = 68.75, 241
FINGERS_MM = np.array([(-33.0, 10.0), (19.0, -35.0)])
TARGETS_UM = np.array([1.0, 0.0])
LABELS = ("1 µm: slippery", "#4cc3ff"), ("0: sticky", "#ff9e4a")
W_LIMIT_UM = 4.0
SLIPPERY, STICKY, GLASS, SKIN = "#0b6fa4", "#b3500c", "#8fbcd4", "#f3cdb2"
WAVE, SWING, THICK = 2 * np.pi / 6.0, 0.42, 0.5  # of the section


def main(path: Path) -> None:
    """Write the picture."""
    shapes = {shape.name: shape for _, shape in free_plate_modes()}
    modes = [shapes[name] for name in DRIVEN_MODES]
    phi = np.stack([mode.evaluate(FINGERS_MM) for mode in modes], axis=-1)
    w_um = solve(phi, TARGETS_UM, W_LIMIT_UM).modal_um
    axis_mm = np.linspace(-HALF_MM, HALF_MM, POINTS)
    fields = [amplitude * mode.on_grid(axis_mm, axis_mm) for amplitude, mode in zip(w_um, modes, strict=True)]

    figure, axes = plotting.subplots(13.2, 4.3, 1, 4, source="simulated plate", width_ratios=(1.45, 1, 1, 1))
    section, *plates = axes[0]
    _draw_section(section)
    largest_um = float(np.ceil(2 * np.abs(fields).max()) / 2)
    for axis, field, name, amplitude in zip(plates, fields, "XY", w_um, strict=False):
        image = _draw_field(axis, field, "RdBu", (-largest_um, largest_um))
        axis.set_title(f"mode {name} times $W_{name}={amplitude:+.2f}$ µm")
        figure.colorbar(image, ax=axis, location="bottom", label="µm", shrink=0.8)
    image = _draw_field(plates[2], np.abs(sum(fields)), "viridis", (0.0, None))
    plates[2].set_title("together: vibration $|W|$")
    figure.colorbar(image, ax=plates[2], location="bottom", label="µm, peak to peak", shrink=0.8)
    for axis, sign in zip(plates[1:], "+=", strict=True):
        axis.text(-0.095, 0.5, sign, transform=axis.transAxes, ha="center", va="center", fontsize=22)
    for (x_mm, y_mm), (said, colour) in zip(FINGERS_MM, LABELS, strict=True):
        for axis in plates:
            axis.plot(x_mm, y_mm, "o", ms=11, mfc=colour, mec="black", mew=1.3)
        box = {"boxstyle": "round,pad=0.25", "fc": "#14181bd0", "ec": "none"}
        plates[2].text(x_mm, y_mm + 11, said, color=colour, ha="center", weight="bold", bbox=box)
    plotting.save(figure, path, dpi=90)


def _draw_field(axis: Any, field: Any, colours: str, span_um: tuple[float, float | None]) -> Any:
    extent = (-HALF_MM, HALF_MM, -HALF_MM, HALF_MM)
    axis.set(xticks=(), yticks=())
    return axis.imshow(field, origin="lower", extent=extent, cmap=colours, vmin=span_um[0], vmax=span_um[1])


def _draw_section(axis: Any) -> None:
    """The vibrating plate from the side, a finger over an antinode and one on a node."""
    x = np.linspace(0.0, 12.0, 400)
    swing = SWING * np.sin(WAVE * x)
    axis.fill_between(x, -swing - THICK, -swing, color=GLASS, alpha=0.3, lw=0)
    axis.fill_between(x, swing - THICK, swing, color=GLASS, lw=0, zorder=3)
    antinode, node = 1.5, 9.0
    film = np.linspace(antinode - 0.9, antinode + 0.9, 50)
    axis.fill_between(film, SWING * np.sin(WAVE * film), SWING + 0.35, color="#cfeaf7", lw=0)
    _draw_finger(axis, antinode, SWING + 0.35)
    _draw_finger(axis, node, -0.25)
    arrow = {"arrowstyle": "<->", "color": "black", "shrinkA": 0, "shrinkB": 0, "lw": 1.2}
    axis.annotate("", (4.5, -SWING), (4.5, SWING), arrowprops=arrow, zorder=4)
    axis.text(5.25, 1.0, "about 1 µm,\n29 205 times\na second", va="bottom", ha="center")
    axis.text(antinode, -1.5, "slippery", color=SLIPPERY, ha="center", weight="bold", fontsize="large")
    axis.text(antinode, -1.8, "squeezed air carries\npart of the finger", ha="center", va="top")
    axis.text(node, -1.5, "sticky", color=STICKY, ha="center", weight="bold", fontsize="large")
    axis.text(node, -1.8, "where the plate stands\nstill, glass stays glass", ha="center", va="top")
    axis.set(xlim=(-1.2, 12.2), ylim=(-4.6, 5.6), xticks=(), yticks=())
    axis.set_title("the plate from the side, not to scale", y=0.93)
    axis.spines[:].set_visible(False)


def _draw_finger(axis: Any, x: float, y: float) -> None:
    """A fingertip that comes down to height `y`, flattened where it rests."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    points = [(-1.0, 3.6), (-1.0, 1.5), (-1.0, 0.3), (-0.75, 0.0), (-0.45, 0.0), (0.45, 0.0)]
    points += [(0.75, 0.0), (1.0, 0.3), (1.0, 1.5), (1.0, 3.6)]
    codes = [
        Outline.MOVETO,
        Outline.LINETO,
        *[Outline.CURVE4] * 3,
        Outline.LINETO,
        *[Outline.CURVE4] * 3,
        Outline.LINETO,
    ]
    outline = Outline([(x + dx, y + dy) for dx, dy in points], codes)
    axis.add_patch(PathPatch(outline, fc=SKIN, ec="#8a5a3c", lw=1.4))


if __name__ == "__main__":
    main(Path(sys.argv[1]))

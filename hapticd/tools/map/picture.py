"""Maps of friction felt as asked, as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...design.felt_places import ENOUGH_JND, FeltMap
from .. import plotting
from .plate import MappedPlate

DPI, COLOURS = 100, 128
MOST_JND = 4.0  # of the colours
_OTHERS, _EDGE = "#4cc3ff", "white"


class FeltPanel(NamedTuple):
    """One map: the given fingers, their frictions and the other one's last."""

    fingers_mm: Sequence[Sequence[float]]
    frictions: Sequence[float]
    result: FeltMap


def draw(figure: Any, path: Path) -> None:
    """Write a figure. Raises HapticdError as `plotting.save`."""
    plotting.save(figure, path, dpi=DPI, colours=COLOURS)


def felt_figure(panels: Sequence[FeltPanel], mapped: MappedPlate) -> Any:
    """Return a figure with a panel for each map: the error of the finger that is served worst, 1 as a line."""
    figure, grid = plotting.subplots(4.9 * len(panels) + 1.2, 5.6, 1, len(panels), layout="compressed", sharey=True)
    axes = grid[0]
    axes[0].set_ylabel("y, mm")
    half_x, half_y = (edge_mm / 2 for edge_mm in mapped.size_mm)
    look = {"vmin": 0.0, "vmax": MOST_JND, "cmap": "viridis_r", "extent": (-half_x, half_x, -half_y, half_y)}
    for axis, (fingers_mm, frictions, result) in zip(axes, panels, strict=True):
        image = axis.imshow(result.largest_jnd, origin="lower", **look)
        if result.largest_jnd.min() < ENOUGH_JND < result.largest_jnd.max():
            axis.contour(result.x_mm, result.y_mm, result.largest_jnd, [ENOUGH_JND], colors=_EDGE, linewidths=1.2)
        for (x_mm, y_mm), friction in zip(fingers_mm, frictions, strict=False):
            axis.plot(x_mm, y_mm, "o", ms=10, mfc=_OTHERS, mec="black", mew=1.2, clip_on=False)
            side = -1 if x_mm > 0.0 else 1  # towards the middle, where there is room
            box = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8}
            axis.annotate(
                f"{friction:g}",
                (x_mm, y_mm),
                (9 * side, 0),
                textcoords="offset points",
                ha="left" if side > 0 else "right",
                va="center",
                fontsize=9,
                bbox=box,
            )
        axis.set_title(f"friction {frictions[-1]:g} here: as asked on {100 * result.felt_frac:.0f} %", fontsize=10)
        axis.set_xlabel("x, mm: the other finger's position")
    scale = figure.colorbar(image, ax=axes, pad=0.02, extend="max")
    scale.set_label("largest error of a finger, just noticeable differences")
    axes[0].plot([], [], "o", ms=8, mfc=_OTHERS, mec="black", label="given finger and its friction")
    axes[0].plot([], [], color="grey", lw=1.2, label="white line: 1 just noticeable difference")
    columns = min(len(panels), 2)  # beside the version at the right
    names = axes[0].get_legend_handles_labels()
    figure.legend(*names, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure

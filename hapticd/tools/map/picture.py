"""Maps of friction felt as asked, as pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ...design.felt_map import FeltMap, FeltPairs
from ...design.felt_places import ENOUGH_JND
from ...values import FloatArray
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
    figure, axes = _canvas(len(panels))
    for axis, (fingers_mm, frictions, result) in zip(axes, panels, strict=True):
        image = _draw_image(axis, result.largest_jnd, mapped.size_mm, vmin=0.0, vmax=MOST_JND, cmap="viridis_r")
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


def pairs_figure(pairs: FeltPairs, asked: Sequence[float], mapped: MappedPlate) -> Any:
    """Return a figure of both shares, on one scale."""
    figure, axes = _canvas(2)
    room_mm = [centres_mm.size * float(centres_mm[1] - centres_mm[0]) for centres_mm in (pairs.x_mm, pairs.y_mm)]
    for axis, share, friction in zip(axes, pairs.shares, asked, strict=True):
        image = _draw_image(axis, share, room_mm, vmin=0.0, vmax=1.0)
        half_mm = [edge_mm / 2 for edge_mm in mapped.size_mm]
        axis.set(xlim=(-half_mm[0], half_mm[0]), ylim=(-half_mm[1], half_mm[1]))
        axis.set_title(f"a finger with friction {friction:g} is here", fontsize=10)
        axis.set_xlabel("x, mm")
    scale = figure.colorbar(image, ax=axes, pad=0.02)
    scale.set_label("share of the other finger's positions: both as asked")
    return figure


def _canvas(columns: int) -> tuple[Any, Any]:
    """Return a figure and its axes, a plate each."""
    figure, grid = plotting.subplots(4.9 * columns + 1.2, 5.6, 1, columns, layout="compressed", sharey=True)
    grid[0, 0].set_ylabel("y, mm")
    return figure, grid[0]


def _draw_image(axis: Any, values: FloatArray, size_mm: Sequence[float], **look: Any) -> Any:
    """Draw values over a rectangle about the middle."""
    extent = (-size_mm[0] / 2, size_mm[0] / 2, -size_mm[1] / 2, size_mm[1] / 2)
    return axis.imshow(values, origin="lower", extent=extent, **{"cmap": "viridis"} | look)

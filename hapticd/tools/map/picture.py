"""The achievability map as a picture: the share that the slipping finger gets, over the other finger's position."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core.plate.mode_shapes import ModeShapes
from ...design.achievability import AchievabilityMap, MapFinger, PairMap
from ...values import FloatArray
from .. import plotting

DPI = 100
NODES_PER_SIDE = 201
_SLIPPERY, _STICKY, _SINGULAR = "#4cc3ff", "#ff9e4a", "#ff4d6d"


class Panel(NamedTuple):
    """One map: what the other finger is to do, in words, and the fingers present."""

    title: str
    fingers: tuple[MapFinger, ...]
    result: AchievabilityMap


def draw(panels: Sequence[Panel], modes: ModeShapes, size_mm: tuple[float, float], path: Path) -> None:
    """Write the panels side by side. Raises HapticdError as `plotting.save`."""
    figure, axes = canvas(len(panels))
    for axis, panel in zip(axes, panels, strict=True):
        image = _draw_panel(axis, panel, modes, size_mm)
    scale = figure.colorbar(image, ax=axes, pad=0.02)
    scale.set_label("share of its target that the worst served slipping finger gets")
    _save(figure, axes, path)


def draw_pairs(pairs: PairMap, modes: ModeShapes, size_mm: tuple[float, float], path: Path) -> None:
    """Write both maps on one scale. Raises HapticdError as `plotting.save`."""
    figure, axes = canvas(2)
    lowest = float(min(pairs.slipping.min(), pairs.still.min()))
    titles = ("slips here, the other still", "is still here, the other slips")
    for axis, part, title in zip(axes, (pairs.slipping, pairs.still), titles, strict=True):
        image = _draw_field(axis, part, modes, size_mm, lowest)
        axis.set_title(f"a finger {title}", fontsize=10)
        axis.set_xlabel("x, mm")
    scale = figure.colorbar(image, ax=axes, pad=0.02)
    scale.set_label("part of the plate where the other finger can be")
    _save(figure, axes, path)


def canvas(columns: int) -> tuple[Any, Any]:
    """Return a figure and its axes, a plate each."""
    figure, grid = plotting.subplots(4.9 * columns + 1.2, 5.6, 1, columns, layout="compressed", sharey=True)
    grid[0, 0].set_ylabel("y, mm")
    return figure, grid[0]


def _save(figure: Any, axes: Any, path: Path) -> None:
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    plotting.save(figure, path, dpi=DPI)


def _draw_panel(axis: Any, panel: Panel, modes: ModeShapes, size_mm: tuple[float, float]) -> Any:
    result = panel.result
    image = _draw_field(axis, result.share, modes, size_mm, 0.0)
    if not np.isnan(result.determinant).any() and _changes_sign(result.determinant):
        axis.contour(result.x_mm, result.y_mm, result.determinant, levels=[0.0], colors=_SINGULAR, linewidths=1.1)
        axis.plot([], [], color=_SINGULAR, lw=1.1, label="singular: no amplitude left")
    for finger in panel.fingers:
        colour, letter = (_STICKY, "o") if finger.target_um == 0.0 else (_SLIPPERY, "D")
        axis.plot(finger.x_mm, finger.y_mm, letter, ms=10, mfc=colour, mec="black", mew=1.2, clip_on=False)
    axis.plot([], [], "D", ms=8, mfc=_SLIPPERY, mec="black", label="slips")
    axis.plot([], [], "o", ms=8, mfc=_STICKY, mec="black", label="still")
    served = f"{100 * result.served_frac(1.0):.0f} % of the plate at full target"
    axis.set_title(f"{panel.title.replace(' um', ' µm')}: {served}", fontsize=10)
    axis.set_xlabel("x, mm: the other finger's position")
    return image


def _draw_field(axis: Any, values: FloatArray, modes: ModeShapes, size_mm: tuple[float, float], lowest: float) -> Any:
    """Draw values from `lowest` to 1 as colours over the whole plate, with the node lines on top."""
    image = draw_image(axis, values, size_mm, vmin=lowest, vmax=1.0, interpolation="bilinear")
    _draw_nodes(axis, modes, size_mm)
    axis.set(xlim=image.get_extent()[:2], ylim=image.get_extent()[2:])
    return image


def draw_image(axis: Any, values: FloatArray, size_mm: Sequence[float], **look: Any) -> Any:
    """Draw values over a rectangle about the middle."""
    extent = (-size_mm[0] / 2, size_mm[0] / 2, -size_mm[1] / 2, size_mm[1] / 2)
    return axis.imshow(values, origin="lower", extent=extent, **{"cmap": "viridis"} | look)


def _draw_nodes(axis: Any, modes: ModeShapes, size_mm: tuple[float, float]) -> None:
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, NODES_PER_SIDE) for edge_mm in size_mm)
    shapes = modes.evaluate(np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)).T
    for shape in shapes.reshape(-1, y_mm.size, x_mm.size):
        if _changes_sign(shape):
            axis.contour(x_mm, y_mm, shape, levels=[0.0], colors="black", linewidths=0.6, alpha=0.45)
    axis.plot([], [], color="black", lw=0.6, alpha=0.6, label="node lines of the modes")


def _changes_sign(values: Any) -> bool:
    return bool(values.min() < 0.0 < values.max())

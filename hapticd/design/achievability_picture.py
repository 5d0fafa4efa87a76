"""The achievability map as a picture: what the slipping finger gets, for each place of the other one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.errors import HapticdError

from .achievability import AchievabilityMap, Finger
from .achievability_pairs import PairMap
from .legendre import FloatArray

DPI = 100
NODES_PER_SIDE = 201
_SLIPPERY, _STICKY, _SINGULAR = "#4cc3ff", "#ff9e4a", "#ff4d6d"


class Panel(NamedTuple):
    """What is asked of the other finger, in words; the fingers that are there; and the map."""

    wish: str
    fingers: tuple[Finger, ...]
    made: AchievabilityMap


def draw(panels: Sequence[Panel], modes: ModeShapes, size_mm: tuple[float, float], path: Path) -> None:
    """Write a PNG, a panel beside the other. Raises HapticdError without matplotlib, or where it cannot be written."""
    figure, axes = _canvas(len(panels))
    for axis, panel in zip(axes, panels, strict=True):
        image = _draw_panel(axis, panel, modes, size_mm)
    scale = figure.colorbar(image, ax=axes, pad=0.02)
    scale.set_label("what the worst served slipping finger gets of its target")
    _save(figure, axes, path)


def draw_pairs(pairs: PairMap, modes: ModeShapes, size_mm: tuple[float, float], path: Path) -> None:
    """Write a PNG of both maps on one scale. Raises HapticdError as `draw`."""
    figure, axes = _canvas(2)
    lowest = float(min(pairs.slipping.min(), pairs.still.min()))
    wishes = ("slips here, the other still", "is still here, the other slips")
    for axis, part, wish in zip(axes, (pairs.slipping, pairs.still), wishes, strict=True):
        image = _draw_field(axis, part, modes, size_mm, lowest)
        axis.set_title(f"a finger {wish}", fontsize=10)
        axis.set_xlabel("x, mm")
    scale = figure.colorbar(image, ax=axes, pad=0.02)
    scale.set_label("part of the plate where the other finger can be")
    _save(figure, axes, path)


def _canvas(columns: int) -> tuple[Any, Any]:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise HapticdError('A picture needs matplotlib: install it with `pip install "hapticd[plot]"`.') from None
    figure = Figure(figsize=(4.9 * columns + 1.2, 5.6), layout="compressed")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, columns, sharey=True, squeeze=False)[0]
    axes[0].set_ylabel("y, mm")
    return figure, axes


def _save(figure: Any, axes: Any, path: Path) -> None:
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    try:
        figure.savefig(path, dpi=DPI, format="png")
    except OSError as error:
        raise HapticdError(f"The picture cannot be written to {path}: {error.strerror or error}.") from None


def _draw_panel(axis: Any, panel: Panel, modes: ModeShapes, size_mm: tuple[float, float]) -> Any:
    made = panel.made
    image = _draw_field(axis, made.share, modes, size_mm, 0.0)
    if not np.isnan(made.determinant).any() and _changes_sign(made.determinant):
        axis.contour(made.x_mm, made.y_mm, made.determinant, levels=[0.0], colors=_SINGULAR, linewidths=1.1)
        axis.plot([], [], color=_SINGULAR, lw=1.1, label="singular: nothing is left")
    for finger in panel.fingers:
        colour, letter = (_STICKY, "o") if finger.target_um == 0.0 else (_SLIPPERY, "D")
        axis.plot(finger.x_mm, finger.y_mm, letter, ms=10, mfc=colour, mec="black", mew=1.2, clip_on=False)
    axis.plot([], [], "D", ms=8, mfc=_SLIPPERY, mec="black", label="slips")
    axis.plot([], [], "o", ms=8, mfc=_STICKY, mec="black", label="still")
    axis.set_title(f"{panel.wish.replace(' um', ' µm')}: {_served(made)}", fontsize=10)
    axis.set_xlabel("x, mm: where the other finger is")
    return image


def _draw_field(axis: Any, values: FloatArray, modes: ModeShapes, size_mm: tuple[float, float], lowest: float) -> Any:
    """Values of `lowest` to 1 in colours, edge to edge, and the node lines over them."""
    half_x_mm, half_y_mm = size_mm[0] / 2, size_mm[1] / 2
    image = axis.imshow(
        values,
        origin="lower",
        extent=(-half_x_mm, half_x_mm, -half_y_mm, half_y_mm),
        cmap="viridis",
        vmin=lowest,
        vmax=1.0,
        interpolation="bilinear",
    )
    _draw_nodes(axis, modes, size_mm)
    axis.set_xlim(-half_x_mm, half_x_mm)
    axis.set_ylim(-half_y_mm, half_y_mm)
    return image


def _draw_nodes(axis: Any, modes: ModeShapes, size_mm: tuple[float, float]) -> None:
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, NODES_PER_SIDE) for edge_mm in size_mm)
    shapes = modes.evaluate(np.stack(np.meshgrid(x_mm, y_mm), axis=-1).reshape(-1, 2)).T
    for shape in shapes.reshape(-1, y_mm.size, x_mm.size):
        if _changes_sign(shape):
            axis.contour(x_mm, y_mm, shape, levels=[0.0], colors="black", linewidths=0.6, alpha=0.45)
    axis.plot([], [], color="black", lw=0.6, alpha=0.6, label="node lines of the modes")


def _changes_sign(values: Any) -> bool:
    return bool(values.min() < 0.0 < values.max())


def _served(made: AchievabilityMap) -> str:
    return f"{100 * made.served_frac(1.0):.0f} % of the plate as asked"

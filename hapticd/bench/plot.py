"""The tables as one picture, a panel for each: error over run time on log axes, a named point per alternative."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..files import plotting
from .tables import Row, Table, stem, unit

_PANEL_INCHES = (7.6, 5.0)
_DEFAULT_COLOUR, _COLOUR = "tab:red", "tab:blue"
_BARS = (("hot_us", "tab:blue"), ("paced_us", "tab:orange"))
_DIRECTIONS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_GAP_PX = 3.0
_TITLE_COLUMNS = 84
_RADII_PT = (7.0, 16.0, 27.0, 40.0, 56.0)


def draw(tables: Sequence[Table], path: Path) -> None:
    """Write a PNG. Raises HapticdError where matplotlib is missing or the file cannot be written."""
    columns = min(len(tables), 2)
    lines = math.ceil(len(tables) / columns)
    figure, grid = plotting.subplots(_PANEL_INCHES[0] * columns, _PANEL_INCHES[1] * lines, lines, columns)
    axes = grid.flat
    scatters = []
    for table, axis in zip(tables, axes, strict=False):
        axis.set_title(textwrap.fill(table.title, _TITLE_COLUMNS), fontsize="medium")
        if table.time:
            scatters.append((axis, _scatter(axis, table)))
        elif table.across:
            _lines(axis, table)
        else:
            _bars(axis, table)
    for axis in list(axes)[len(tables) :]:
        axis.set_axis_off()
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # what is placed now stays where it is
    for axis, points in scatters:
        _label(figure, axis, points)
    plotting.save(figure, path)


def _scatter(axis: Any, table: Table) -> list[tuple[Row, float, float]]:
    points = [
        (row, row.figures[table.time], max(row.figures[table.error], table.floor))
        for row in table.rows
        if table.time in row.figures and row.figures.get(table.error, 0.0) >= 0.0
    ]
    shown = [y for _, _, y in points if y > table.floor]
    lowest = min(shown, default=1.0) / 10  # where what is nothing is drawn
    points = [(row, x, y if y > table.floor else lowest) for row, x, y in points]
    for row, x, y in points:
        if row.name == table.default:
            axis.plot([x], [y], marker="*", ms=12, color=_DEFAULT_COLOUR, ls="none", zorder=4)
        else:
            axis.plot([x], [y], marker="o", ms=6, color=_COLOUR, ls="none", zorder=3)
    _log_axes(axis)
    _widen(axis, [x for _, x, _ in points], [y for _, _, y in points])
    axis.set_xlabel(_heading(table.time))
    axis.set_ylabel(_heading(table.error))
    if len(shown) < len(points):
        axis.axhline(lowest, color="black", lw=0.9, ls=":", zorder=1)
        axis.set_ylabel(f"{_heading(table.error)} (dotted: none but rounding)")
    return points


def _log_axes(axis: Any) -> None:
    """Logarithmic both ways, with plain numbers."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_xscale("log")
    axis.set_yscale("log")
    for ticked in (axis.xaxis, axis.yaxis):
        ticked.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        ticked.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
        ticked.set_minor_formatter(NullFormatter())
    axis.grid(which="major", lw=0.4)


def _widen(axis: Any, xs: Sequence[float], ys: Sequence[float]) -> None:
    """Room for the names: a part of each axis' decades, and enough decades that it has a number on it."""
    for values, widen, share in ((xs, axis.set_xlim, 0.22), (ys, axis.set_ylim, 0.14)):
        low, high = math.log10(min(values)), math.log10(max(values))
        room = max(share * (high - low), 0.3)
        widen(10 ** (low - room), 10 ** (high + room))


def _label(figure: Any, axis: Any, points: Sequence[tuple[Row, float, float]]) -> None:
    """Names beside their points: for each the nearest place where it covers no other name and no point."""
    renderer = figure.canvas.get_renderer()
    frame = axis.get_window_extent(renderer)
    at = [axis.transData.transform((x, y)) for _, x, y in points]
    half = 5.0 * plotting.DPI / 72
    taken = [(x - half, y - half, x + half, y + half) for x, y in at]
    for (row, x, y), (x_px, y_px) in sorted(zip(points, at, strict=True), key=lambda one: -float(one[1][1])):
        text = axis.annotate(row.name, (x, y), xytext=(0, 0), textcoords="offset points", fontsize=8.5, zorder=5)
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.3})
        size = text.get_window_extent(renderer)
        best: tuple[float, tuple[float, float], tuple[float, float, float, float]] | None = None
        for order, (radius_pt, (right, up)) in enumerate((r, d) for r in _RADII_PT for d in _DIRECTIONS):
            dx = right * radius_pt * plotting.DPI / 72 - (size.width * (1 - right) / 2)
            dy = up * radius_pt * plotting.DPI / 72 - size.height / 2
            box = (x_px + dx, y_px + dy, x_px + dx + size.width, y_px + dy + size.height)
            outside = box[0] < frame.x0 or box[1] < frame.y0 or box[2] > frame.x1 or box[3] > frame.y1
            cost = order + 1000 * outside + 100 * sum(_overlap(box, other) for other in taken)
            if best is None or cost < best[0]:
                best = cost, (dx, dy), box
        assert best is not None
        _, (dx, dy), box = best
        taken.append(box)
        text.set_position((dx * 72 / plotting.DPI, dy * 72 / plotting.DPI))
        near_x, near_y = min(max(x_px, box[0]), box[2]), min(max(y_px, box[1]), box[3])
        if math.hypot(near_x - x_px, near_y - y_px) > 10 * plotting.DPI / 72:
            ends = axis.transData.inverted().transform([(x_px, y_px), (near_x, near_y)])
            axis.plot(*ends.T, color="grey", lw=0.5, zorder=0)


def _overlap(one: tuple[float, float, float, float], other: tuple[float, float, float, float]) -> bool:
    return one[0] < other[2] + _GAP_PX and other[0] < one[2] + _GAP_PX and one[1] < other[3] and other[1] < one[3]


def _bars(axis: Any, table: Table) -> None:
    names = [row.name for row in table.rows]
    for index, (figure, colour) in enumerate(_BARS):
        values = [row.figures.get(figure, 0.0) for row in table.rows]
        if any(values):
            places = [place + 0.2 * (2 * index - 1) for place in range(len(names))]
            bars = axis.barh(places, values, height=0.38, color=colour, label=stem(figure))
            axis.bar_label(bars, labels=[f"{value:.0f}" for value in values], padding=3, fontsize=8.5)
    axis.set_yticks(range(len(names)), names)
    axis.invert_yaxis()
    axis.margins(x=0.12)
    axis.set_xlabel("time of a pass, us")
    axis.legend(loc="lower right")


def _lines(axis: Any, table: Table) -> None:
    lines: dict[str, list[Row]] = {}
    for row in table.rows:
        lines.setdefault(row.name.rpartition(", ")[0], []).append(row)
    for name, rows in lines.items():
        xs = [row.figures[table.across] for row in rows]
        axis.plot(xs, [row.figures[table.error] for row in rows], marker="o", label=name)
    _log_axes(axis)
    axis.set_xlabel(_heading(table.across))
    axis.set_ylabel(_heading(table.error))
    axis.legend()


def _heading(figure: str) -> str:
    return f"{stem(figure).replace('_', ' ')}, {unit(figure)}"

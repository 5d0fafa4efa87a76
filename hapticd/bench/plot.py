"""The tables as one picture: error over run time on log axes, or the run times of passes as bars."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..tools import plotting
from .tables import Table, stem, unit

_PANEL_INCHES = (7.6, 5.0)
_DEFAULT_COLOUR = "tab:red"
_COLOURS = [f"tab:{name}" for name in ("blue", "orange", "green", "purple", "brown", "pink", "grey", "olive", "cyan")]
_MARKERS = "osD^v"
_BARS = (("hot_us", "tab:blue"), ("paced_us", "tab:orange"))
_TITLE_COLUMNS = 84
_LEAST_SPAN = 10.0  # of a logarithmic axis: a shorter one may have no labelled tick


def draw(tables: Sequence[Table], path: Path) -> None:
    """Write a PNG. Raises HapticdError where matplotlib is missing or the file cannot be written."""
    columns = min(len(tables), 2)
    lines = -(-len(tables) // columns)
    figure, grid = plotting.subplots(_PANEL_INCHES[0] * columns, _PANEL_INCHES[1] * lines, lines, columns)
    axes = grid.ravel().tolist()
    for table, axis in zip(tables, axes, strict=False):
        axis.set_title(textwrap.fill(table.title, _TITLE_COLUMNS), fontsize="medium")
        (_scatter if table.time else _bars)(axis, table)
    for axis in axes[len(tables) :]:
        axis.set_axis_off()
    plotting.save(figure, path)


def _scatter(axis: Any, table: Table) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    points = [
        (row.name, row.figures[table.time], row.figures[table.error])
        for row in table.rows
        if table.time in row.figures and row.figures.get(table.error, -1.0) >= 0.0
    ]
    lowest = min((y for _, _, y in points if y > table.floor), default=1.0) / 10.0
    for index, (name, x, y) in enumerate(points):
        is_default = name == table.default
        axis.plot(
            [x],
            [y if y > table.floor else lowest],
            marker="*" if is_default else _MARKERS[index // len(_COLOURS) % len(_MARKERS)],
            markersize=12 if is_default else 6,
            color=_DEFAULT_COLOUR if is_default else _COLOURS[index % len(_COLOURS)],
            linestyle="none",
            label=name if y > table.floor else f"{name} (rounding)",
        )
    for index, row in enumerate(table.rows):
        if table.time not in row.figures and row.figures.get(table.error, -1.0) > table.floor:
            colour = _COLOURS[index % len(_COLOURS)]
            axis.axhline(row.figures[table.error], color=colour, ls=":", lw=1.2, label=f"{row.name} (no run time)")
    for scaled, set_scale in ((axis.xaxis, axis.set_xscale), (axis.yaxis, axis.set_yscale)):
        set_scale("log")
        low, high = scaled.get_view_interval()
        wider = max(math.sqrt(_LEAST_SPAN * low / high), 1.0)
        scaled.set_view_interval(low / wider, high * wider, ignore=True)
        scaled.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        scaled.set_major_formatter("{x:.6g}")
        scaled.set_minor_formatter(NullFormatter())
    axis.grid(which="major", linewidth=0.4)
    axis.set_xlabel(_heading(table.time))
    axis.set_ylabel(_heading(table.error))
    axis.legend(fontsize=8.5)


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
    axis.set_xscale("log")
    axis.margins(x=0.12)
    axis.set_xlabel("time of a pass, us")
    axis.legend(loc="lower right")


def _heading(figure: str) -> str:
    return f"{stem(figure).replace('_', ' ')}, {unit(figure)}"

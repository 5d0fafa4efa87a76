"""Tables of benchmarks: figures by alternative, as text and as JSON.

A figure's name ends in its unit (`time_us`, `leak_um`). An alternative lacks a figure that it has not, or that is not
finite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Table:
    """Alternatives compared in one run, the default first."""

    name: str
    title: str
    rows: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...] = ()

    def figure(self, row: str, name: str) -> float:
        """Return a figure; NaN where there is none."""
        return self.rows[row].get(name, math.nan)


def plain(table: Table) -> dict[str, Any]:
    """Return the table for JSON: finite numbers and strings only."""
    alternatives = {
        row: {name: float(value) for name, value in figures.items() if math.isfinite(value)}
        for row, figures in table.rows.items()
    }
    return {"title": table.title, "default": next(iter(table.rows)), "alternatives": alternatives}


def render(table: Table) -> str:
    """Return the table as text."""
    lines = [["", *(names := dict.fromkeys(name for row in table.rows.values() for name in row))]]
    lines += [[f"  {row}", *(number(table.figure(row, name)) for name in names)] for row in table.rows]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    texts = [table.title]
    for first, *cells in lines:
        columns = (f"  {cell:>{width}}" for cell, width in zip(cells, widths[1:], strict=True))
        texts.append(f"{first:<{widths[0]}}{''.join(columns)}".rstrip())
    return "\n".join([*texts, *(f"  {note}" for note in table.notes)])


def number(value: float) -> str:
    """Format with three significant digits, without an exponent down to 1e-6; counts as they are."""
    if not math.isfinite(value):
        return "-"
    if value == round(value) and abs(value) < 1e9:
        return f"{value:.0f}"
    digits = 2 - int(f"{value:.2e}".partition("e")[2])
    return f"{value:.0e}" if digits > 6 else f"{value:.{max(digits, 0)}f}"

"""Results of a benchmark: rows of figures, ratios to the default, as text and as JSON.

Every figure's name ends in its unit (`time_us`, `leak_um`, `limits_broken_count`), and a ratio's in `_ratio`.
Only finite numbers are kept: an alternative without a figure lacks its key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

UNITS = {
    "_count": "",
    "_code": "",
    "_frac": "frac",
    "_deg": "deg",
    "_us": "us",
    "_ms": "ms",
    "_mm": "mm",
    "_um": "um",
    "_jnd": "JND",
    "_hz": "Hz",
    "_v": "V",
    "_h": "h",
    "_mb": "MB",
}  # longest suffix first, where one ends another
SPREAD = "_spread"
_NAME_WIDTH = 30
_GAP = "  "


@dataclass(frozen=True, slots=True)
class _Row:
    """One alternative and its figures."""

    name: str
    figures: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Table:
    """Alternatives compared in one run.

    `compared` names the figures whose ratios to the row `default` are given. A picture shows the figure `error` over
    `time`; error figures below `floor` count as zero. `skipped` has the reason for each missing alternative.
    """

    name: str
    title: str
    default: str
    rows: tuple[_Row, ...]
    compared: tuple[str, ...]
    time: str = ""
    error: str = ""
    floor: float = 0.0
    skipped: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def row(self, name: str) -> _Row:
        """Return the row of this name; KeyError if there is none."""
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(name)

    def columns(self) -> list[str]:
        """Return the names of all figures, in the order of their first appearance."""
        return list(dict.fromkeys(name for row in self.rows for name in row.figures))

    def ratios(self, row: _Row) -> dict[str, float]:
        """Return the compared figures over the default's, where both are positive numbers."""
        base = self.row(self.default).figures
        ratios: dict[str, float] = {}
        for name in self.compared:
            value, reference = row.figures.get(name, math.nan), base.get(name, math.nan)
            least = self.floor if name == self.error else 0.0
            if value >= least and reference > least:  # False for NaN
                ratios[ratio_name(name)] = value / reference
        return ratios


def unit(name: str) -> str:
    """Return the unit at the end of a figure's name."""
    return next((text for suffix, text in UNITS.items() if name.endswith(suffix)), "")


def stem(name: str) -> str:
    """Return a figure's name without its unit."""
    return next((name.removesuffix(suffix) for suffix in UNITS if name.endswith(suffix)), name)


def ratio_name(name: str) -> str:
    """Return the name of the ratio of a figure to the default's."""
    return f"{stem(name)}_ratio"


def plain(table: Table) -> dict[str, Any]:
    """Return the table for JSON: finite numbers and strings only."""
    return {
        "title": table.title,
        "default": table.default,
        "alternatives": {row.name: {**_finite(row.figures), **table.ratios(row)} for row in table.rows},
        "skipped": dict(table.skipped),
    }


def render(table: Table) -> str:
    """Return the table as text; compared figures carry their ratio to the default's."""
    columns = [_Column(table, name) for name in table.columns() if not stem(name).endswith(SPREAD)]
    name_width = max(_NAME_WIDTH, *(len(row.name) + 2 for row in table.rows))
    lines = [table.title]
    for part in (0, 1):
        heads = [column.heading[part] for column in columns]
        lines.append(
            " " * name_width + "".join(_GAP + head.rjust(c.width) for head, c in zip(heads, columns, strict=True))
        )
    for row in table.rows:
        mark = "* " if row.name == table.default else "  "
        cells = [column.cell(row).rjust(column.width) for column in columns]
        lines.append((mark + row.name).ljust(name_width) + "".join(_GAP + cell for cell in cells))
    lines += [f"  {name}: skipped, {why}" for name, why in table.skipped.items()]
    lines += [f"  {note}" for note in table.notes]
    return "\n".join(line.rstrip() for line in lines)


class _Column:
    """One printed column: a figure, with its spread and ratio if it has them."""

    def __init__(self, table: Table, name: str) -> None:
        self._table, self._name = table, name
        self._spread = stem(name) + SPREAD + name.removeprefix(stem(name))
        self._has_spread = any(self._spread in row.figures for row in table.rows)
        self._ratio = ratio_name(name) if name in table.compared else ""
        self.heading = stem(name).replace("_", " "), unit(name) + (" (spread)" if self._has_spread else "")
        self.width = max(len(text) for text in (*self.heading, *(self.cell(row) for row in table.rows)))

    def cell(self, row: _Row) -> str:
        value = row.figures.get(self._name, math.nan)
        if not math.isfinite(value):
            return "-"
        text = self._number(value)
        if self._has_spread:
            spread = row.figures.get(self._spread)
            text += " " * 8 if spread is None else f" ({number(spread):>5})"
        if self._ratio:
            ratio = self._table.ratios(row).get(self._ratio)
            text += f" {'' if ratio is None else 'x' + number(ratio):>7}"
        return text

    def _number(self, value: float) -> str:
        if self._name.endswith("_count"):
            return f"{value:.0f}"
        if self._name == self._table.error and value < self._table.floor:
            return "0"
        return number(value)


def number(value: float) -> str:
    """Format with three significant digits, without an exponent down to 1e-6."""
    if value == 0.0:
        return "0"
    digits = 2 - int(f"{value:.2e}".partition("e")[2])
    if digits > 6:
        return f"{value:.0e}"
    return f"{value:.{max(digits, 0)}f}"


def finite_rows(rows: Sequence[tuple[str, Mapping[str, float]]]) -> tuple[_Row, ...]:
    """Return rows with their finite figures as plain floats."""
    return tuple(_Row(name, _finite(figures)) for name, figures in rows)


def _finite(figures: Mapping[str, float]) -> dict[str, float]:
    return {
        name: int(value) if name.endswith("_count") else float(value)
        for name, value in figures.items()
        if math.isfinite(value)
    }

"""What a benchmark found: rows of figures with their units, ratios to the default, for a person and as JSON.

Every figure's name ends in its unit (`time_us`, `leak_um_per_um`, `limits_broken_count`), and a ratio's in `_ratio`.
Only finite numbers are kept: an alternative that has no such figure has no such key.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

UNITS = {
    "_um_per_um": "um/um",
    "_count": "",
    "_frac": "frac",
    "_deg": "deg",
    "_us": "us",
    "_ns": "ns",
    "_ms": "ms",
    "_mm": "mm",
    "_um": "um",
    "_hz": "Hz",
    "_v": "V",
}  # longest suffix first, where one ends another
SPREAD = "_spread"
_NAME_WIDTH = 30
_GAP = "  "


@dataclass(frozen=True, slots=True)
class Row:
    """One alternative and its figures."""

    name: str
    figures: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Table:
    """Alternatives compared in one run.

    `compared` names the figures whose ratios to the row `default` are told. A picture sets the figure
    `error` over `time`; or draws it as lines over `across`, rows named "line, where"; or, without either, as a bar for
    each row. Error figures below `floor` count as nothing. `skipped` says why an alternative is missing.
    """

    name: str
    title: str
    default: str
    rows: tuple[Row, ...]
    compared: tuple[str, ...]
    time: str = ""
    error: str = ""
    across: str = ""
    floor: float = 0.0
    skipped: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def row(self, name: str) -> Row:
        """The alternative of this name; KeyError where there is none."""
        for row in self.rows:
            if row.name == name:
                return row
        raise KeyError(name)

    def columns(self) -> list[str]:
        """All figures' names, in the order in which the rows first have them."""
        return list(dict.fromkeys(name for row in self.rows for name in row.figures))

    def ratios(self, row: Row) -> dict[str, float]:
        """The compared figures over the default's, where both mean something."""
        base = self.row(self.default).figures
        told: dict[str, float] = {}
        for name in self.compared:
            value, reference = row.figures.get(name, math.nan), base.get(name, math.nan)
            least = self.floor if name == self.error else 0.0
            if value >= least and reference > least:  # False for NaN
                told[ratio_name(name)] = value / reference
        return told


def unit(name: str) -> str:
    """The unit that a figure's name ends in."""
    return next((text for suffix, text in UNITS.items() if name.endswith(suffix)), "")


def stem(name: str) -> str:
    """A figure's name without its unit."""
    return next((name.removesuffix(suffix) for suffix in UNITS if name.endswith(suffix)), name)


def ratio_name(name: str) -> str:
    """What the ratio of a figure to the default's is called."""
    return f"{stem(name)}_ratio"


def plain(table: Table) -> dict[str, Any]:
    """The table for JSON: finite numbers and texts only."""
    return {
        "title": table.title,
        "default": table.default,
        "alternatives": {row.name: {**_finite(row.figures), **table.ratios(row)} for row in table.rows},
        "skipped": dict(table.skipped),
    }


def render(table: Table) -> str:
    """The table for a person: figures with the ratio to the default's beside those that are compared."""
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
    lines += [f"  {name}: left out, {why}" for name, why in table.skipped.items()]
    lines += [f"  {note}" for note in table.notes]
    return "\n".join(line.rstrip() for line in lines)


class _Column:
    """One printed column: a figure, its spread where there is one, and its ratio where it is compared."""

    def __init__(self, table: Table, name: str) -> None:
        self._table, self._name = table, name
        self._spread = stem(name) + SPREAD + name.removeprefix(stem(name))
        self._has_spread = any(self._spread in row.figures for row in table.rows)
        self._ratio = ratio_name(name) if name in table.compared else ""
        self.heading = stem(name).replace("_", " "), unit(name) + (" (spread)" if self._has_spread else "")
        self.width = max(len(text) for text in (*self.heading, *(self.cell(row) for row in table.rows)))

    def cell(self, row: Row) -> str:
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
    """Three significant digits, without an exponent where a person can do without."""
    if value == 0.0:
        return "0"
    digits = 2 - int(f"{value:.2e}".partition("e")[2])
    if digits > 6:
        return f"{value:.0e}"
    return f"{value:.{max(digits, 0)}f}"


def finite_rows(rows: Sequence[tuple[str, Mapping[str, float]]]) -> tuple[Row, ...]:
    """Rows of their finite figures, as plain floats."""
    return tuple(Row(name, _finite(figures)) for name, figures in rows)


def _finite(figures: Mapping[str, float]) -> dict[str, float]:
    return {
        name: int(value) if name.endswith("_count") else float(value)
        for name, value in figures.items()
        if math.isfinite(value)
    }

"""Figures of runs for hours that must hold what they promise, and a sentence per violation.

`python tests/soak endurance --hours 100` plays so many hours of virtual time: a campaign on all cores, or with
--cluster, whose workers need `tests` in their PYTHONPATH.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from hapticd.bench.tables import Table, render
from hapticd.errors import HapticdError

ALL = "all"
MOST_SENTENCES = 20


@dataclass(frozen=True, slots=True)
class Findings:
    """Figures of one run, or of a part of it, by the row that they belong to; and a sentence for each violation."""

    rows: Mapping[str, Mapping[str, float]]
    failures: list[str] = field(default_factory=list)


def added(found: Iterable[Findings]) -> Findings:
    """Return the findings of all runs: counts and hours are summed, of others the largest stays."""
    rows: dict[str, dict[str, float]] = {}
    failures: list[str] = []
    for one in found:
        failures += one.failures
        for row, figures in one.rows.items():
            own = rows.setdefault(row, {})
            for name, value in figures.items():
                before = own.get(name, value)
                is_sum = name in own and name.endswith(("_count", "_h"))
                own[name] = before + value if is_sum else max(before, value)
    return Findings(rows, failures)


def judged(found: Iterable[Findings], *, name: str, title: str, notes: tuple[str, ...]) -> Table:
    """Play the runs and return their table, the row of all first. Raises HapticdError with the violations if there are
    any."""
    every = added(found)
    rows = {ALL: every.rows.get(ALL) or added(Findings({ALL: row}) for row in every.rows.values()).rows[ALL]}
    rows |= {row: figures for row, figures in sorted(every.rows.items()) if row != ALL}
    table = Table(name, f"{name}: {title}", rows, notes=("peaks and times: the largest of all runs", *notes))
    if every.failures:
        sentences = [f"{name}: {len(every.failures)} failures:", *every.failures[:MOST_SENTENCES]]
        raise HapticdError("\n".join([*sentences, render(table)]))
    return table

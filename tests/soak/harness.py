"""What all soaks share: runs for hours that must hold what they promise, their figures, and a sentence per violation.

endurance  the firmware on random plates, with fingers and textures
daemon     the daemon and the firmware amid faults
walk       the solver for friction as asked, step after step

`python tests/soak endurance --hours 100` plays so many hours of virtual time, `daemon` too.
`walk --steps 10000000` takes so many steps of the solver. It and endurance are campaigns: on all cores, or with
--cluster, whose workers need `tests` in their PYTHONPATH.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from hapticd.bench.tables import Table, finite_rows, render
from hapticd.errors import HapticdError

ALL = "all"
MOST_SENTENCES = 20


@dataclass(frozen=True, slots=True)
class Findings:
    """Figures of one run, or of a part of it, by the row that they belong to; and a sentence for each violation."""

    rows: Mapping[str, Mapping[str, float]]
    failures: list[str] = field(default_factory=list)


def added(found: Iterable[Findings]) -> Findings:
    """Return the findings of all runs: counts and hours are summed, of first and last figures the first and the last
    stays, of others the largest."""
    rows: dict[str, dict[str, float]] = {}
    failures: list[str] = []
    for one in found:
        failures += one.failures
        for row, figures in one.rows.items():
            own = rows.setdefault(row, {})
            for name, value in figures.items():
                own[name] = _added(name, own[name], value) if name in own else value
    return Findings(rows, failures)


def _added(name: str, before: float, now: float) -> float:
    if "_first_" in name:
        return before
    if "_last_" in name:
        return now
    return before + now if name.endswith(("_count", "_h")) else max(before, now)


def judged(found: Iterable[Findings], *, name: str, title: str, notes: tuple[str, ...]) -> Table:
    """Play the runs and return their table, the row of all first. Raises HapticdError with the violations if there are
    any."""
    every = added(found)
    rows = {ALL: every.rows.get(ALL) or added(Findings({ALL: row}) for row in every.rows.values()).rows[ALL]}
    rows |= {row: figures for row, figures in sorted(every.rows.items()) if row != ALL}
    table = Table(
        name=name,
        title=f"{name}: {title}",
        default=ALL,
        rows=finite_rows([*rows.items()]),
        compared=(),
        notes=("peaks and times: the largest of all runs", *notes),
    )
    if every.failures:
        sentences = [f"{name}: {len(every.failures)} failures:", *every.failures[:MOST_SENTENCES]]
        raise HapticdError("\n".join([*sentences, render(table)]))
    return table

"""What the slipping finger's share of its 1 um depends on: the shapes that W_LIM = 4 um counts in, and a third mode.

Each kind of shapes (`sim.plate.shapes`) is the simulated plate's truth, scanned and fitted like the default one, with
the board's amplifiers sized for it. A third mode, the first of the neighbouring pair, has an amplifier of its own. The
fade (`core.solver.derating`) gives amplitude away for less leak: without it the loop comes nearest to what the limits
allow. Beside the whole loop stands perfect knowledge: true positions and shapes, an exact zero, no fade.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..sim.lockstep import Settings, perfect
from ..sim.plate.shapes import FREE_PLATE, KINDS
from .leak_runs import SCENARIO, SECONDS, SEEDS, Figures, Played, compared, swapped
from .tables import Table, finite_rows

DEFAULT = f"{FREE_PLATE}, 2 modes"
W_LIMIT_UM = 4.0


def alternatives() -> dict[str, Settings]:
    """By name, the settings of a run for each kind of shapes, with two modes and with three, with and without fade."""
    ours = Settings()
    fades: dict[str, dict[str, dict[str, object]]] = {"": {}, ", no fade": {"solver": {"fade": 0.0}}}
    return {
        f"{kind}, {modes} modes{suffix}": replace(
            ours,
            plate=replace(ours.plate, shapes=kind, driven_modes=modes),
            config=swapped(ours.config, {"limits": {"w_limit_um": (W_LIMIT_UM,) * modes}, **changes}),
        )
        for kind in KINDS
        for modes in (2, 3)
        for suffix, changes in fades.items()
    }


def run(*, seeds: Sequence[int] = SEEDS, seconds: float = SECONDS, names: Sequence[str] | None = None) -> Table:
    """Compare the shapes (all, or those in `names` and the default), with the whole loop and with perfect knowledge."""
    chosen = {name: settings for name, settings in alternatives().items() if names is None or name in (*names, DEFAULT)}
    return Table(
        name="leak_share",
        title=f"leak: share of 1 um within 4 um of each mode, {SCENARIO} at 10 cm/s, by what the 4 um count in",
        default=DEFAULT,
        rows=finite_rows(compared(chosen, _shares, seeds=seeds, seconds=seconds, timed=False)),
        compared=("slip_frac", "leak_um"),
        error="leak_um",
        notes=(
            "free plate: shapes peak at 1 over the plate, which is at its edges; peak at fingers: at X's highest "
            "antinode 10 mm from the edge or further in; cosines: the paper's waves without an edge",
            "perfect: the slipping finger's share under perfect knowledge, and how often a limit binds there",
        ),
    )


def _shares(played: Played) -> Figures:
    known, got = perfect(played.run), played.run.score
    return {
        "slip_frac": got.slip_frac,
        "leak_um": got.leak_um,
        "limited_frac": got.limited_frac,
        "perfect_slip_frac": known.slip_frac,
        "perfect_limited_frac": known.limited_frac,
    }

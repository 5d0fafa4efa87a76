"""What a simulated run amounts to: its figures beside the paper's scheme and perfect knowledge, and its arrays."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import lockstep
from .lockstep import Run
from .score import Score

ARRAYS = (
    "t_s",
    "finger_true_mm",
    "finger_predicted_mm",
    "target_um",
    "reference_um",
    "modal_um",
    "truth_um",
    "limited",
)
SETTLED_FRAC = 0.02  # a step has settled when it stays within 2 % of its size


def figures(played: Run, *, compare: bool = True) -> dict[str, Any]:
    """Plain numbers for JSON; null where a figure has no meaning. With `compare`, the same fingers (trajectories,
    seeds, plate) under the paper's scheme and under perfect knowledge."""
    told: dict[str, Any] = {
        "scenario": played.scenario,
        "seed": played.seed,
        "seconds": float(played.t_s[-1]),
        "w_limit_um": list(played.settings.config.limits.w_limit_um),
        "hapticd": _plain(played.score),
    }
    if played.scenario == "step":
        told["step"] = step_response(played.t_s, played.modal_um[:, 0], t_step_s=1.0)
    if compare:
        baseline = lockstep.run(
            played.scenario, settings=lockstep.paper(played.settings), seed=played.seed, seconds=float(played.t_s[-1])
        )
        told["paper"] = _plain(baseline.score)
        told["perfect"] = _plain(lockstep.perfect(played))
        if played.score.leak_um > 0 and math.isfinite(baseline.score.leak_um):
            told["leak_ratio"] = baseline.score.leak_um / played.score.leak_um
    told["status"] = played.status
    return told


def step_response(
    t_s: npt.NDArray[np.float64], w_um: npt.NDArray[np.complex128], *, t_step_s: float
) -> dict[str, float]:
    """Figure 7's numbers for a step of one axis: `w_um` (T,) from 0 to its final value, asked for at `t_step_s`.

    Times count from where W_d first leaves 1 % of its final value: before that lies the link's delay, not the loop's.
    """
    part = t_s >= t_step_s
    final_um = float(np.mean(w_um[part][-200:].real))
    left = np.flatnonzero(w_um[part].real > 0.01 * final_um)[0]
    away = np.flatnonzero(np.abs(w_um[part].real - final_um) > SETTLED_FRAC * final_um)
    period_s = float(t_s[1] - t_s[0])
    return {
        "final_um": final_um,
        "settling_ms": float(away[-1] + 1 - left + 1) * period_s * 1e3,
        "overshoot_frac": float(w_um[part].real.max() / final_um - 1),
        "largest_q_um": float(np.abs(w_um[part].imag).max()),
    }


def table(told: Mapping[str, Any]) -> str:
    """The figures for a person."""
    rows = [f"{'':<10}{'leak um':>9}{'slip error um':>15}{'slip':>8}{'limited':>9}"]
    for scheme in ("hapticd", "paper", "perfect"):
        if scheme in told:
            line = told[scheme]
            cells = (line["leak_um"], line["slip_error_um"], line["slip_frac"], line["limited_frac"])
            widths = (9, 15, 8, 9)
            rows.append(
                f"{scheme:<10}"
                + "".join(f"{'-' if x is None else format(x, '.3f'):>{w}}" for x, w in zip(cells, widths, strict=True))
            )
    if "leak_ratio" in told:
        rows.append(f"the paper's scheme leaks {told['leak_ratio']:.1f} times as much")
    if "step" in told:
        rows.append("step of {final_um:.3f} um: settles in {settling_ms:.1f} ms".format(**told["step"]))
    return "\n".join(rows)


def save(played: Run, path: Path) -> None:
    """Write the run's arrays to an NPZ file."""
    np.savez_compressed(path, **{name: getattr(played, name) for name in ARRAYS})


def _plain(scored: Score) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in dataclasses.asdict(scored).items()}

"""Report of a simulated run: its figures against the paper's scheme and perfect knowledge, and its arrays."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ..regular_file import opened
from ..values import OnProgress
from . import lockstep
from .fingers.scenarios import STEP_S
from .lockstep import Run
from .perfect import Perfect, perfect
from .score import Score
from .settings import paper_settings, scheme_config

ARRAYS = (
    "t_s",
    "finger_id",
    "finger_true_mm",
    "finger_predicted_mm",
    "target_um",
    "reference_um",
    "modal_um",
    "truth_um",
    "limited",
)
PERFECT_ARRAYS = ("t_s", "modal_um", "truth_um", "limited")
_COLUMNS = (
    ("felt", "felt_frac", 7),
    ("within two JND", "within_two_frac", 16),
    ("leak um", "leak_um", 9),
    ("slip error um", "slip_error_um", 15),
    ("slip", "slip_frac", 8),
    ("contact leak um", "contact_leak_um", 17),
    ("contact slip um", "contact_slip_um", 17),
    ("contrast", "contrast", 10),
    ("limited", "limited_frac", 9),
)
_FINGER_COLUMNS = (
    ("bias", "bias_jnd", 8),
    ("median", "median_jnd", 8),
    ("95 %", "error_95_jnd", 8),
    ("within one", "felt_frac", 12),
    ("two JND", "within_two_frac", 9),
)
SETTLED_FRAC = 0.02  # a step has settled when it stays within 2 % of its size
FINAL_S = 0.1  # its final value is the mean over the run's end
STEP_WATCHED_S = 0.2  # a shorter run has no final value


class Compared(NamedTuple):
    """The same run (trajectories, seeds, plate) under the paper's scheme and under perfect knowledge."""

    paper: Run
    perfect: Perfect


def compare(played: Run, progress: Callable[[str], OnProgress] = lambda _: lambda _: None) -> Compared:
    """Play the run's fingers again; `progress` returns the callback for a part of the work, by its name."""
    scenario = played.scenario if played.played is None else played.played
    paper = lockstep.run(
        scenario,
        settings=paper_settings(played.settings),
        seed=played.seed,
        seconds=float(played.t_s[-1]),
        progress=progress("the paper's scheme"),
    )
    return Compared(paper, perfect(played, progress=progress("perfect knowledge")))


def figures(played: Run, compared: Compared | None = None) -> dict[str, Any]:
    """Return plain numbers for JSON; null where a figure is undefined."""
    report: dict[str, Any] = {
        "scenario": played.scenario,
        "seed": played.seed,
        "seconds": float(played.t_s[-1]),
        "w_limit_um": list(scheme_config(played.settings).limits.w_limit_um),
        "hapticd": _plain(played.score),
    }
    if played.scenario == "step" and report["seconds"] > STEP_S + STEP_WATCHED_S:
        report["step"] = step_response(played.t_s, played.modal_um[:, 0], t_step_s=STEP_S)
    if compared is not None:
        report["paper"] = _plain(compared.paper.score)
        report["perfect"] = _plain(compared.perfect.score)
        if played.score.leak_um > 0 and math.isfinite(compared.paper.score.leak_um):
            report["leak_ratio"] = compared.paper.score.leak_um / played.score.leak_um
    report["status"] = played.status
    return report


def step_response(
    t_s: npt.NDArray[np.float64], w_um: npt.NDArray[np.complex128], *, t_step_s: float
) -> dict[str, float]:
    """Return the figures of a step response as in the paper's figure 7: `w_um` (T,) of one axis, step at `t_step_s`.

    `settling_ms` counts from where W_d exceeds 1 % of its final value (before that is the link's delay) to where it
    stays within SETTLED_FRAC of it. The final W_d may have either sign: the plate's phase is free.
    """
    after_um = w_um[t_s >= t_step_s]
    period_s = float(t_s[1] - t_s[0])
    final_um = float(np.mean(after_um[-round(FINAL_S / period_s) :].real))
    progress = after_um.real / final_um
    left = int(np.flatnonzero(progress > 0.01)[0])
    settled = int(np.flatnonzero(np.abs(progress - 1) > SETTLED_FRAC)[-1]) + 1
    return {
        "final_um": final_um,
        "settling_ms": (settled - left + 1) * period_s * 1e3,
        "overshoot_frac": float(progress.max() - 1),
        "largest_q_um": float(np.abs(after_um.imag).max()),
    }


def table(report: Mapping[str, Any]) -> str:
    """Format the figures as a table."""
    schemes = [scheme for scheme in ("hapticd", "paper", "perfect") if scheme in report]
    rows = [_row("", _COLUMNS)]
    rows += [_row(scheme, _COLUMNS, report[scheme]) for scheme in schemes]
    rows.append(_row("error, JND", _FINGER_COLUMNS))
    for scheme in schemes:
        for number, finger in enumerate(report[scheme]["fingers"], 1):
            rows.append(_row(f"{scheme}, finger {number}", _FINGER_COLUMNS, finger))
    if "leak_ratio" in report:
        rows.append(f"the paper's scheme leaks {report['leak_ratio']:.1f} times as much")
    if "step" in report:
        rows.append("step of {final_um:.3f} um: settles in {settling_ms:.1f} ms".format(**report["step"]))
    return "\n".join(rows)


def _row(name: str, columns: Sequence[tuple[str, str, int]], figures: Mapping[str, Any] | None = None) -> str:
    """Return a line of a table, its heading without `figures`."""
    cells = []
    for heading, key, width in columns:
        figure = heading if figures is None else "-" if figures[key] is None else f"{figures[key]:.3f}"
        cells.append(f"{figure:>{width}}")
    return f"{name:<18}" + "".join(cells)


def save(played: Run, path: Path, compared: Compared | None = None) -> None:
    """Write the run's arrays to an NPZ file, with those of the comparison under paper_ and perfect_."""
    arrays = {name: getattr(played, name) for name in ARRAYS}
    if compared is not None:
        arrays |= {f"paper_{name}": getattr(compared.paper, name) for name in ARRAYS}
        arrays |= {f"perfect_{name}": getattr(compared.perfect, name) for name in PERFECT_ARRAYS}
    with opened(path) as file:
        np.savez_compressed(file, **arrays)


def _plain(scored: Score) -> dict[str, Any]:
    figures = dataclasses.asdict(scored)
    fingers = [_finite(finger) for finger in figures.pop("fingers")]
    return {**_finite(figures), "fingers": fingers}


def _finite(figures: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in figures.items()}

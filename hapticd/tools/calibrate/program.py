"""`hapticd calibrate`: each step measures, judges, draws and saves; without one, what is done and what is next."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ...errors import CalibrationError
from . import delays, folder, friction, modes, resonance, trackpad
from .verdict import Outcome, Verdict, as_text

RUN: dict[str, Callable[[argparse.Namespace], Verdict]] = {
    "resonance": resonance.run,
    "modes": modes.run,
    "trackpad": trackpad.run,
    "latency": delays.run,
    "friction": friction.run,
}


def run(options: argparse.Namespace) -> int:
    """One step, all steps, or the overview; 1 where a step failed."""
    if options.step is None:
        print(folder.overview(options.out))
        return 0
    if options.seed < 0:
        raise CalibrationError(f"--seed is {options.seed}: give 0 or more.")
    folder.prepare(options.out, is_simulated=options.sim)
    steps = [*RUN] if options.step == "all" else [options.step]
    outcomes = [_step(step, options) for step in steps]
    return 1 if Outcome.FAIL in outcomes else 0


def _step(step: str, options: argparse.Namespace) -> Outcome:
    verdict = folder.accepted(RUN[step](options))
    path = folder.save(options.out, verdict)
    print(as_text(verdict))
    if verdict.outcome is Outcome.FAIL:
        print(f"Nothing of it goes into {path}; the picture is {options.out / step}.png.\n")
    else:
        print(f"For the service's configuration, and in {path} already:")
        print(folder.as_toml(verdict.settings), flush=True)
    return verdict.outcome

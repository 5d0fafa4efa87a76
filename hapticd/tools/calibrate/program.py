"""`hapticd calibrate`: arguments of all steps; each step measures, judges, draws and saves.

Without a step it prints the overview. Each step is a module with a STEP
(`step`), found when this command is chosen: no other imports them.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..arguments import add_command, whole

DEFAULT_OUT = Path("calibration")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description} Without a step: the order, and the steps done so far."
    parser.epilog = f"{parser.epilog}\n         hapticd run --config DIR/hapticd.toml"
    parser.add_argument("--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help="results (default calibration)")
    parser.add_argument("--sim", action="store_true", help="measure the simulated plate")
    parser.set_defaults(command=_run, step=None)
    steps = parser.add_subparsers(title="steps", metavar="STEP")
    from .step import in_order  # late, for the sake of what steps import
    from .step import steps as all_steps

    for one in all_steps().values():
        step = _step(steps, one.name, one.summary, one.example, is_sim_asked=one.is_simulated is None)
        for add in one.arguments:
            add(step)
    whole_plate = _step(steps, "all", "run in order all steps that have not passed yet", "--sim --out DIR")
    for add in dict.fromkeys(add for name in in_order() for add in all_steps()[name].arguments):
        add(whole_plate)


def _step(steps: Any, name: str, summary: str, example: str, *, is_sim_asked: bool = True) -> argparse.ArgumentParser:
    parser = add_command(steps, name, summary, example)
    # Suppressed, so that the default of the parent parser remains.
    parser.add_argument("--out", type=Path, default=argparse.SUPPRESS, metavar="DIR", help="results")
    parser.add_argument("--force", action="store_true", help="overwrite files in DIR that no step wrote")
    if is_sim_asked:
        parser.add_argument("--sim", action="store_true", default=argparse.SUPPRESS, help="measure the simulated plate")
        parser.add_argument("--seed", type=whole(0), default=1, help="of the simulated measurements (default 1)")
    parser.set_defaults(step=name)
    return parser


def _run(options: argparse.Namespace) -> int:
    """Run one step, all steps, or print the overview; 1 if a step failed."""
    from ...errors import CalibrationError
    from ..outputs import require_matplotlib
    from . import folder, walk
    from .step import in_order, steps
    from .verdict import Outcome

    if options.step is None:
        print(folder.overview(options.out, is_simulated=options.sim))
        return 0
    require_matplotlib()
    if getattr(options, "participant", None) is not None:
        if options.step == "all":
            raise CalibrationError("--participant is for the friction alone: hapticd calibrate friction --participant.")
        options.out = folder.of_participant(options.out, options.participant)
    chosen = [steps()[name] for name in (in_order() if options.step == "all" else [options.step])]
    for step in chosen:
        if step.is_simulated is not None:  # its inputs are of one plate or the other
            step.check(options)
            options.sim = step.is_simulated(options)
    given = [value for name, value in vars(options).items() if isinstance(value, Path) and name != "out"]
    names = [step.name for step in chosen]
    folder.prepare(options.out, names, given, is_simulated=options.sim, is_forced=options.force)
    if options.step == "all":
        return walk.all_steps(options)
    chosen[0].check(options)
    return 1 if walk.run_step(chosen[0], options).outcome is Outcome.FAIL else 0

"""`hapticd calibrate`: arguments of all steps; each step measures, judges, draws and saves.

Without a step it prints the overview. On a bare rig a step that fails is mended and run again, and nothing after it
runs before.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ...config import person
from ...errors import CalibrationError, DeviceError
from .. import glass
from ..arguments import add_command, whole
from ..outputs import require_matplotlib
from . import folder
from .bench import at_bench
from .step import MissingInput, Outcome, Step, Verdict, about, in_order, steps


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description} Without a step: the order, and the steps done so far."
    parser.epilog = f"{parser.epilog}\n         hapticd run --config DIR/hapticd.toml"
    parser.add_argument(
        "--out", type=Path, default=person.CALIBRATION, metavar="DIR", help="results (default calibration)"
    )
    parser.add_argument("--sim", action="store_true", help="measure the simulated plate")
    parser.set_defaults(command=_run, step=None)
    commands = parser.add_subparsers(title="steps", metavar="STEP")
    for one in steps().values():
        step = _add_step(commands, one.name, one.summary, one.example, is_sim_asked=one.is_simulated is None)
        for add in one.arguments:
            add(step)
    whole_plate = _add_step(commands, "all", "run in order all steps that have not passed yet", "--sim --out DIR")
    for add in dict.fromkeys(add for name in in_order() for add in steps()[name].arguments):
        add(whole_plate)


def _add_step(
    commands: Any, name: str, summary: str, example: str, *, is_sim_asked: bool = True
) -> argparse.ArgumentParser:
    parser = add_command(commands, name, summary, example)
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
    if options.step is None:
        print(folder.overview(options.out, is_simulated=options.sim))
        return 0
    require_matplotlib()
    if getattr(options, "participant", None) is not None:
        if options.step == "all":
            raise CalibrationError("--participant is for one step: hapticd calibrate person, or friction.")
        options.out = person.folder_of(options.out, options.participant)
    if hasattr(options, "plate"):
        glass.chosen(options, is_simulated=options.sim)
    chosen = [steps()[name] for name in (in_order() if options.step == "all" else [options.step])]
    for step in chosen:
        if step.is_simulated is not None:  # its inputs are of one plate or the other
            step.check(options)
            options.sim = step.is_simulated(options)
    given = [value for name, value in vars(options).items() if isinstance(value, Path) and name != "out"]
    names = [step.name for step in chosen]
    folder.prepare(options.out, names, given, is_simulated=options.sim, is_forced=options.force)
    if options.step == "all":
        return _all(options)
    chosen[0].check(options)
    return 1 if run_step(chosen[0], options).outcome is Outcome.FAIL else 0


def _all(options: argparse.Namespace) -> int:
    """Run what has not passed yet of all steps, in their order; 1 if one fails, or lacks what it reads.

    Raises HapticdError.
    """
    done, wiring = folder.load(options.out), options.wiring
    chosen: list[str] = []
    lacking = ""
    for name in folder.left(done, wiring):
        try:
            steps()[name].check(options)  # what is wrong with the last step is said before the first
        except MissingInput as error:
            if not chosen:
                raise
            lacking = lacking or f"{error}\nGo on with the same --out ({options.out})."
        if not lacking:
            chosen.append(name)
    outcome = walk([steps()[name] for name in folder.in_all(done, wiring)], options, chosen)
    if outcome is not Outcome.FAIL:
        print(lacking or f"All steps have passed: hapticd run --config {options.out / folder.CONFIG_FILE}")
    return 1 if lacking or outcome is Outcome.FAIL else 0


def walk(order: Sequence[Step], options: argparse.Namespace, left: Sequence[str]) -> Outcome:
    """Run the steps that are left, in their order; return FAIL if one of them failed. Raises HapticdError.

    On a bare rig it goes back to where a mended flaw may have been measured, and ends where nothing is found to mend.
    """
    names, to_run, outcome = [step.name for step in order], set(left), Outcome.PASS
    is_bare = any(step.is_of_bare_rig for step in order)
    while to_run:
        place = next(place for place, name in enumerate(names) if name in to_run)
        step = order[place]
        is_mendable = is_bare and step.back_to is not None
        print(f"\n{f' {place + 1} of {len(order)}: {step.name} ':=^78}", flush=True)
        try:
            verdict = run_step(step, options)
        except DeviceError as error:
            if not is_mendable:
                raise
            verdict = Verdict(step.name, Outcome.FAIL, str(error), (), {}, options.sim)
            keep(verdict, options)
        to_run.discard(step.name)
        if verdict.outcome is Outcome.FAIL and not is_mendable:
            outcome = Outcome.FAIL
        elif verdict.outcome is Outcome.FAIL:
            if not _is_mended(verdict, options):
                return Outcome.FAIL
            again = names[names.index(step.back_to or step.name) : place + 1]
            folder.forget(options.out, again)
            to_run.update(again)
    return outcome


def _is_mended(verdict: Verdict, options: argparse.Namespace) -> bool:
    with at_bench(options) as bench:
        return bench.person.mend(verdict.findings)


def run_step(step: Step, options: argparse.Namespace) -> Verdict:
    """Run one step, and keep its verdict. Raises HapticdError."""
    found = step.run(options)
    verdict = folder.accepted(replace(found, settings={**about(options), **found.settings}))
    keep(verdict, options)
    return verdict


def keep(verdict: Verdict, options: argparse.Namespace) -> None:
    """Write a verdict to the folder, and print it. Raises HapticdError."""
    if person.SECTION in verdict.settings and verdict.outcome is not Outcome.FAIL:
        folder.forget(options.out, {"friction", "person"} - {verdict.step})  # the last one measured counts
    path = folder.save(options.out, verdict)
    print(verdict, flush=True)
    if verdict.outcome is Outcome.FAIL:
        picture = options.out / f"{verdict.step}.png"
        print(f"{path} stays without this step{f'; its picture is {picture}' if picture.exists() else ''}.\n")
    elif verdict.settings:
        print(f"Settings, written to {path}:")
        print(folder.as_toml(verdict.settings), flush=True)

"""From one step to the next; on a bare rig one that fails is mended and run again, and nothing after it runs before."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from ...errors import DeviceError
from . import folder
from .bench import at_bench
from .step import MissingInput, Step, steps
from .verdict import Outcome, Verdict, as_text


def all_steps(options: argparse.Namespace) -> int:
    """Run what has not passed yet of all steps, in their order; 1 if one fails, or lacks what it reads.

    Raises HapticdError.
    """
    done, wiring = folder.load(options.out), options.wiring
    left = folder.left(done, wiring)
    if not left:
        print(folder.overview(options.out))
        return 0
    chosen: list[Step] = []
    lacking = ""
    for step in (steps()[name] for name in left):
        try:
            step.check(options)  # what is wrong with the last step is said before the first
        except MissingInput as error:
            if not chosen:
                raise
            lacking = lacking or f"{error}\nGo on with the same --out ({options.out})."
        if not lacking:
            chosen.append(step)
    order = [steps()[name] for name in folder.in_all(done, wiring)]
    outcome = walk(order, options, [step.name for step in chosen])
    if outcome is Outcome.FAIL:
        return 1
    print(lacking or f"All steps have passed: hapticd run --config {options.out / folder.CONFIG_FILE}")
    return 1 if lacking else 0


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
    verdict = folder.accepted(step.run(options))
    keep(verdict, options)
    return verdict


def keep(verdict: Verdict, options: argparse.Namespace) -> None:
    """Write a verdict to the folder, and print it. Raises HapticdError."""
    path = folder.save(options.out, verdict)
    print(as_text(verdict), flush=True)
    if verdict.outcome is Outcome.FAIL:
        picture = options.out / f"{verdict.step}.png"
        print(f"{path} stays without this step{f'; its picture is {picture}' if picture.exists() else ''}.\n")
    elif verdict.settings:
        print(f"Settings, written to {path}:")
        print(folder.as_toml(verdict.settings), flush=True)

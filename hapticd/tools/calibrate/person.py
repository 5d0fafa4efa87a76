"""A participant's friction curve without a force sensor: which is more slippery, the plate or a reference beside it?

The running service drives the plate; its amplitude is what telemetry says of the finger's contact.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from itertools import islice
from statistics import fmean

from hapticd_client import Client
from hapticd_client import HapticdError as ClientError

from ...design import person as design
from ...design.person import FULL_UM, Answer, Ask, Match
from ...errors import CalibrationError, HapticdError
from ...sim.observer import KINDS, REFERENCE, SimulatedObserver
from .. import arguments
from . import folder
from .step import Figure, MissingInput, Outcome, Step, Verdict, add_participant

STROKED = 90  # states with one finger on the plate, a second, over which its amplitude is averaged
UNSURE_FRAC = 0.15  # of the interval, to one side


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises CalibrationError."""
    if options.participant is None:
        raise MissingInput("No participant is given: add --participant NAME.")
    if options.check and "person" not in folder.load(options.out):
        raise CalibrationError(f"{options.out}: has no curve to check: run it without --check before.")


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises HapticdError."""
    if options.sim:
        return measured(SimulatedObserver(KINDS["usual"], options.seed).compare, options)
    print("One finger strokes the plate, then the reference, as often as you like; the other hand types.")
    try:
        with Client(options.endpoint, name="calibrate-person") as client:
            return measured(lambda amplitude_um: asked(client, amplitude_um), options)
    except ClientError as error:
        raise HapticdError(str(error)) from None
    except EOFError:
        raise CalibrationError("The input ended before the last comparison: nothing is changed.") from None


def measured(ask: Ask, options: argparse.Namespace) -> Verdict:
    """Return the verdict of a calibration, or the one before after a check of it."""
    if not options.check:
        return verdict(design.calibrated(ask, options.reference), options)
    before, trials = folder.load(options.out)["person"], design.CHECK_TRIALS
    count = design.checked(ask, before.figures[0].value or math.nan, options.reference)
    if abs(count - trials // 2) <= design.CHECK_MOST:
        return replace(before, outcome=Outcome.PASS, sentence=f"{trials} comparisons confirm the curve.")
    sentence = f"The plate was more slippery in {count} of {trials} comparisons, not in half: measure again."
    return replace(before, outcome=Outcome.WARN, sentence=sentence)


def verdict(found: Match, options: argparse.Namespace) -> Verdict:
    """Judge a curve."""
    decay_um, _, low_um, high_um = found
    names = ("friction falls to 1/e over", "in 95 of 100 persons from", "to")  # the first is read by `--check`
    figures = tuple(Figure(*one, "um") for one in zip(names, (decay_um, low_um, high_um), strict=True))
    sentence = f"Friction falls to 1/e over {decay_um:.2f} um ({low_um:.2f} .. {high_um:.2f})."
    outcome = Outcome.PASS
    if high_um > (1.0 + UNSURE_FRAC) * decay_um:
        outcome, sentence = Outcome.WARN, f"{sentence} That is wide: measure again."
    plate = {"friction_curve": [0.0, FULL_UM], "friction_floor_frac": round(math.exp(-FULL_UM / decay_um), 4)}
    return Verdict("person", outcome, sentence, figures, {"plate": plate}, options.sim)


def asked(client: Client, amplitude_um: float) -> Answer:
    """Ask the person at the terminal. Raises EOFError at the input's end."""
    client.surface("even", amplitude_um=amplitude_um)
    print("\nStroke the plate ...", flush=True)
    fingers = ([finger for finger in state.fingers if not finger.virtual] for state in client.states())
    alone_um = (one[0].contact_um for one in fingers if len(one) == 1)
    felt_um = fmean(islice((um for um in alone_um if um is not None), STROKED))
    while (key := input("Which is more slippery, plate or reference? [p/r] ").strip().lower()) not in ("p", "r"):
        pass
    return Answer(felt_um, key == "p")


def _add_reference(parser: argparse.ArgumentParser) -> None:
    kind = arguments.number(design.LEAST_REFERENCE, design.MOST_REFERENCE)
    help_text = f"of the sample beside the plate, relative to bare glass (default {REFERENCE:g})"
    parser.add_argument("--reference", type=kind, default=REFERENCE, metavar="FRICTION", help=help_text)
    parser.add_argument("--check", action="store_true", help=f"only compare {design.CHECK_TRIALS} times more")
    arguments.add_endpoint(parser)


STEP = Step(
    name="person",
    order=None,
    summary="measure a participant's friction curve without a force sensor",
    example=f"--participant anna --reference {REFERENCE:g} --out DIR",
    arguments=(add_participant, _add_reference),
    check=check,
    run=run,
)

"""A participant's friction curve without a force sensor: which is more slippery, the plate or a reference beside it?

The running service drives the plate; its amplitude is the even one that gives what telemetry says is felt: where it is
not even over a contact, its RMS is larger. The curve is a resting finger's: by the speed of each comparison, and an
assumed growth with it (`FRICTION_SPEED_MM_S`). The person answers at the terminal or on a page; while that is closed
the comparison waits and the plate is quiet.
"""

from __future__ import annotations

import argparse
import asyncio
import math
from dataclasses import replace
from itertools import count, pairwise
from statistics import fmean
from typing import TYPE_CHECKING

from hapticd_client import Client
from hapticd_client import HapticdError as ClientError

from ...design import person as design
from ...design.person import FRICTION_SPEED_MM_S, FULL_UM, Answer, Ask, Match
from ...errors import CalibrationError, HapticdError, UsageError
from ...sim.observer import KINDS, REFERENCE, SimulatedObserver
from .. import arguments
from ..served_friction import served_curve
from . import folder
from .step import Figure, MissingInput, Outcome, Step, Verdict, add_participant

if TYPE_CHECKING:
    from ..web.questions import QuestionPage

SURFACE = "even"
ANSWERS = {"p": "plate", "r": "reference"}  # keys of the terminal, buttons of the page
STROKED = 90  # states with one finger on the plate, a second, over which its amplitude is averaged
HANDS_MM_S = 100.0  # while they compare
SILENT_S = 10.0  # of a busy service: a person who answered for minutes is not sent away
UNSURE_FRAC = 0.15  # of the interval, to one side


def check(options: argparse.Namespace) -> None:
    """Check the arguments. Raises HapticdError."""
    if options.participant is None:
        raise MissingInput("No participant is given: add --participant NAME.")
    if options.check and "person" not in folder.load(options.out):
        raise CalibrationError(f"{options.out}: has no curve to check: run it without --check before.")
    if options.browser and options.sim:
        raise UsageError("--browser: a person answers there, and with --sim a simulated one: leave out one of them.")


def run(options: argparse.Namespace) -> Verdict:
    """Run the step. Raises HapticdError."""
    if options.sim:
        return measured(SimulatedObserver(KINDS["usual"], options.seed).compare, options)
    if options.browser:
        from ..web.questions import QuestionPage

        page = QuestionPage(__package__, "calibrate person")
        return asyncio.run(page.serve(lambda: _asked(page, options)))
    print("One finger strokes the plate, then the reference, as often as you like; the other hand types.")
    return _asked(TypingFront(), options)


def _asked(front: TypingFront | QuestionPage, options: argparse.Namespace) -> Verdict:
    of, done = design.CHECK_TRIALS if options.check else design.TRIALS, count()
    try:
        with Client(options.endpoint, name="calibrate-person") as client:
            found = measured(lambda um: compared(front, client, um, done=next(done), of=of), options)
    except ClientError as error:
        raise HapticdError(str(error)) from None
    except EOFError:
        raise CalibrationError("The input ended before the last comparison: nothing is changed.") from None
    floors = [math.exp(-FULL_UM / (figure.value or math.nan)) for figure in found.figures]
    front.show(heading=found.sentence, done=of, of=of, is_ready=False, full_um=FULL_UM, floors=floors)
    return found


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
    plate["friction_speed_mm_s"] = FRICTION_SPEED_MM_S
    return Verdict("person", outcome, sentence, figures, {"plate": plate}, options.sim)


class TypingFront:
    """The front of a person who types."""

    is_open = True

    def __init__(self) -> None:
        self._is_ready = False

    def show(self, *, heading: str, is_ready: bool, done: int, of: int, **_: object) -> None:
        self._is_ready = is_ready
        if done < of:  # the verdict is printed as of every step
            print(heading if is_ready else f"\n{heading}", flush=True)

    def pressed(self) -> str:
        """Return the answer, "" while there is no question. Raises EOFError at the input's end."""
        key = ""
        while self._is_ready and not (key := ANSWERS.get(input("[p/r] ").strip().lower(), "")):
            pass
        return key


def compared(front: TypingFront | QuestionPage, client: Client, amplitude_um: float, **progress: int) -> Answer:
    """Ask the person, who may close a page and come back. Raises HapticdError."""
    stroked: list[tuple[float, ...]] = []
    served = client.plate()
    curve, served_mm_s = served_curve(served), served.get("friction_speed_mm_s") or math.inf
    is_laid: bool | None = None  # not known: the page may have been closed since the comparison before
    for state in client.states(SILENT_S):
        if is_laid is not front.is_open:
            is_laid = front.is_open
            laid_um = amplitude_um * (1.0 + HANDS_MM_S / FRICTION_SPEED_MM_S)
            client.surface(SURFACE, amplitude_um=laid_um) if is_laid else client.remove(SURFACE)
            stroked.clear()
            front.show(heading="Stroke the plate …", is_ready=False, **progress)
        key = front.pressed()
        if is_laid and len(stroked) < STROKED:
            fingers = [finger for finger in state.fingers if not finger.virtual]
            if len(fingers) == 1 and fingers[0].felt_friction is not None:
                felt_um = curve.amplitude_um(fingers[0].felt_friction)
                stroked.append((felt_um, fingers[0].x_mm, fingers[0].y_mm, state.t_ns * 1e-9))
            if len(stroked) == STROKED:
                front.show(heading="Which is more slippery, plate or reference?", is_ready=True, **progress)
        elif is_laid and key in ANSWERS.values():
            break
    path_mm = sum(math.dist(last[1:3], one[1:3]) for last, one in pairwise(stroked))
    speed_mm_s = path_mm / (stroked[-1][3] - stroked[0][3])
    moving_um = fmean(one[0] for one in stroked) * (1.0 + speed_mm_s / served_mm_s)
    return Answer(moving_um / (1.0 + speed_mm_s / FRICTION_SPEED_MM_S), key == ANSWERS["p"])


def _add_reference(parser: argparse.ArgumentParser) -> None:
    kind = arguments.number(design.LEAST_REFERENCE, design.MOST_REFERENCE)
    help_text = f"of the sample beside the plate, relative to bare glass (default {REFERENCE:g})"
    parser.add_argument("--reference", type=kind, default=REFERENCE, metavar="FRICTION", help=help_text)
    parser.add_argument("--browser", action="store_true", help="answer on a page beside the plate")
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

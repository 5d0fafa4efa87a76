"""`hapticd play`: a picture, a sound or a haptic pattern under every finger on the plate.

clients/python/CONTENT.md lists the formats. With `--sim` the plate is simulated, and two simulated fingers stroke it.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import hapticd_client
from hapticd_client import Client, content
from hapticd_client.content import Score

from ..errors import HapticdError, UsageError
from . import glass
from .arguments import POSITIVE, add_endpoint, number
from .daemon_process import DaemonProcess

DEFAULT_UM = 1.5
ANSWER_S, SIMULATED_ANSWER_S = 2.0, 60.0
SCENARIO = "strokes"
LEAST_WIDTH_MM, MOST_WIDTH_MM = 0.1, 1000.0  # of any plate
PICTURE_S = 10.0  # of a picture with --sim, where no person ends it


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="a picture, .npy, .wav, .ahap or .hjif")
    parser.add_argument(
        "--high-um",
        type=POSITIVE,
        default=DEFAULT_UM,
        metavar="UM",
        help=f"amplitude of white, or of full intensity (default {DEFAULT_UM:g})",
    )
    parser.add_argument("--friction", action="store_true", help="a picture of friction: black is bare glass")
    parser.add_argument(
        "--width-mm",
        type=number(LEAST_WIDTH_MM, MOST_WIDTH_MM),
        metavar="MM",
        help="width of a picture, which must fit on the plate (default: it fills the plate)",
    )
    parser.add_argument("--loop", action="store_true", help="again and again, until Ctrl-C")
    parser.add_argument(
        "--seconds",
        type=POSITIVE,
        metavar="S",
        help=f"end after so long (default: at its end; a picture never, with --sim after {PICTURE_S:g})",
    )
    parser.add_argument("--participant", metavar="NAME", help="whose friction curve the plate has (default: as it is)")
    parser.add_argument("--sim", action="store_true", help="on a simulated plate, which two simulated fingers stroke")
    glass.add_arguments(parser)
    add_endpoint(parser)
    parser.set_defaults(command=run)


def run(options: argparse.Namespace) -> None:
    """Play the file. Raises UsageError for the file, HapticdError without a service."""
    if options.sim and options.endpoint is not None:
        raise UsageError("--sim starts a service of its own: it cannot be combined with --endpoint.")
    glass.chosen(options, is_simulated=options.sim)
    try:
        score = _loaded(options)
    except hapticd_client.HapticdError as error:
        raise UsageError(f"{error}") from None
    print(score.title, flush=True)
    try:
        with _dropped(), _plate(options) as plate:
            print(_play(score, plate, options))
    except hapticd_client.HapticdError as error:
        raise HapticdError(f"{error}") from None


def _loaded(options: argparse.Namespace) -> Score:
    """Return the file's content; print what of it is dropped."""
    with _dropped():
        return content.load(
            options.file, high_um=options.high_um, is_friction=options.friction, width_mm=options.width_mm
        )


@contextlib.contextmanager
def _dropped() -> Iterator[None]:
    """Print each warning once at the end."""
    with warnings.catch_warnings(record=True) as dropped:
        warnings.simplefilter("always")
        yield
    for sentence, kind in dict.fromkeys((str(one.message), one.category) for one in dropped):
        print(f"not felt as it is: {sentence}" if kind is content.DroppedWarning else sentence, file=sys.stderr)


@contextlib.contextmanager
def _plate(options: argparse.Namespace) -> Iterator[Client]:
    """Return a client of the service, or of one on a simulated plate."""
    with contextlib.ExitStack() as held:
        endpoint, within_s = options.endpoint, ANSWER_S
        if options.sim:
            print("starting a simulated plate and a service for it ...", file=sys.stderr, flush=True)
            sim = replace(glass.chosen(options), scenario=SCENARIO)
            service = DaemonProcess(glass.lines(sim), log_level="error")
            endpoint, within_s = held.enter_context(service).runtime_dir, SIMULATED_ANSWER_S
        client = held.enter_context(Client(endpoint, timeout_s=within_s, person=options.participant))
        if options.sim:
            next(state for state in client.states(SIMULATED_ANSWER_S) if state.fingers)
        yield client


def _check_width(score: Score, plate: Client, width_mm: float | None) -> None:
    """Raise UsageError for a picture that is larger than the plate."""
    from hapticd_client import Rectangle

    shape = score.layers[0].shape if width_mm is not None else None  # with a width it is one picture
    if width_mm is None or not isinstance(shape, Rectangle):
        return
    size_mm = plate.plate()["size_mm"]
    most_mm = min(size_mm[0], size_mm[1] * shape.width_mm / shape.height_mm)
    if width_mm > most_mm:
        raise UsageError(
            f"--width-mm: a picture of {shape.width_mm:g} x {shape.height_mm:g} mm is larger than the plate of "
            f"{size_mm[0]:g} x {size_mm[1]:g} mm: give {LEAST_WIDTH_MM:g} .. {math.floor(10 * most_mm) / 10:g}."
        )


def _play(score: Score, plate: Client, options: argparse.Namespace) -> str:
    """Play until the end; return the largest target of each finger, as far as the states show it."""
    _check_width(score, plate, options.width_mm)
    seconds = math.inf if options.seconds is None else options.seconds
    if options.seconds is None and options.sim and not score.effects:
        seconds = PICTURE_S
    states, felt_um = plate.states(), dict[int | str, float]()

    def look(_seconds: float) -> None:
        for finger in next(states).fingers:
            if finger.target_um is not None:
                felt_um[finger.id] = max(felt_um.get(finger.id, 0.0), finger.target_um)

    score.play(plate, seconds, loops=options.loop, sleep=look)
    return largest(felt_um)


def largest(felt_um: Mapping[int | str, float]) -> str:
    """Return the sentence on the largest target of each finger."""
    if not felt_um:
        return "no finger touched the plate"
    fingers = ", ".join(f"{most_um:.2f} um for finger {finger}" for finger, most_um in sorted(felt_um.items(), key=str))
    return f"largest amplitude asked for, of the states read: {fingers}"

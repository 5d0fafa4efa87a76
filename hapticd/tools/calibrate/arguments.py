"""The arguments of `hapticd calibrate`. Light: what they set going is imported when it is called."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

DEFAULT_OUT = Path("calibration")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The steps, in their order."""
    parser.description = f"{parser.description} Without a step: the order, and what is done already."
    parser.epilog = f"{parser.epilog}\n         hapticd run --config DIR/hapticd.toml"
    parser.add_argument("--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help="results (default calibration)")
    parser.set_defaults(command=_run, step=None)
    steps = parser.add_subparsers(title="steps", metavar="STEP")
    _add_resonance(steps)
    _add_modes(steps)
    _add_trackpad(steps)
    _add_latency(steps)
    _add_friction(steps)
    _add_all(steps)


def add_plate_arguments(parser: argparse.ArgumentParser) -> None:
    """The plate, the pair of modes, and what is written."""
    parser.epilog = (
        f"{parser.epilog}\n\n"
        "materials: glass, float, pilkington, borosilicate, aluminium, steel (hapticd/design/materials.py: sources)"
    )
    parser.add_argument("--size", default="137.5x137.5", metavar="MMxMM", help="width x depth (default 137.5x137.5)")
    parser.add_argument("--thickness", dest="thickness_mm", type=float, default=2.0, metavar="MM", help="default 2")
    parser.add_argument(
        "--material", default="glass", metavar="NAME", help="see below, or GPa,Poisson,kg/m3 (default glass)"
    )
    parser.add_argument("--near", dest="near_hz", type=float, default=29200.0, metavar="HZ", help="default 29200")
    parser.add_argument(
        "--splitting",
        dest="splitting_hz",
        type=float,
        default=60.0,
        metavar="HZ",
        help="of a pair, at most (default 60)",
    )
    parser.add_argument("--pair", type=int, default=1, metavar="N", help="which of the table to take (default 1)")
    parser.add_argument("--stamp", dest="stamp_mm", type=float, default=2.0, metavar="MM", help="radius (default 2)")
    parser.add_argument(
        "--amplitude", dest="amplitude_um", type=float, default=4.0, metavar="UM", help="of both modes (default 4)"
    )
    parser.add_argument("--out", type=Path, metavar="F.npz", help="write the pair's shapes as a mode file")
    parser.add_argument("--plot", type=Path, metavar="F.png", help="draw the shapes and the stamps")
    parser.add_argument("--json", metavar="F", help="write pairs and stamps as JSON; - is standard output")
    parser.set_defaults(command=_run_plate)


def _run_plate(options: argparse.Namespace) -> int:
    from .plate import run

    return run(options)


def _step(steps: Any, name: str, summary: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = steps.add_parser(
        name,
        help=summary,
        description=summary[0].upper() + summary[1:] + ".",
        epilog=f"example: hapticd calibrate {name} {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    # The parent's default must stand where this one is not given.
    parser.add_argument("--out", type=Path, default=argparse.SUPPRESS, metavar="DIR", help="results")
    parser.add_argument("--sim", action="store_true", help="measure the simulated plate")
    parser.add_argument("--seed", type=int, default=1, help="of what is simulated (default 1)")
    parser.set_defaults(step=name)
    return parser


def _add_board(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", help="serial port of the board, such as /dev/ttyACM0")
    parser.add_argument("--baud", type=int, help="its speed (default 921600)")
    parser.add_argument("--config", type=Path, help="the service's configuration, which names the devices")


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--from", dest="start_hz", type=float, metavar="HZ", help="default: 100 Hz below the drive")
    parser.add_argument("--to", dest="stop_hz", type=float, metavar="HZ", help="default: 100 Hz above the drive")
    parser.add_argument("--points", type=int, default=41, help="frequencies of a sweep (default 41)")
    parser.add_argument("--dwell", type=int, default=100, metavar="MS", help="at each (default 100)")
    parser.add_argument("--volts", type=float, help="on the amplifier (default: a tenth of the board's limit)")
    parser.set_defaults(mode=0)  # the sweep's plan is the first mode's, and then each other's


def _add_scan(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scan", type=Path, metavar="FILE", help="the vibrometer's readings, CSV or NPZ")
    parser.add_argument("--size", default="137.5x137.5", metavar="MMxMM", help="of the plate (default 137.5x137.5)")
    parser.add_argument(
        "--own-scale", action="store_true", help="the readings are divided by the modal amplitude: keep their scale"
    )


def _add_marks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--marks", default="-50,-40 50,-40 50,40 -50,40", metavar="'X,Y ...'", help="on the plate in mm, 4 or more"
    )
    parser.add_argument("--model", default="auto", help="of the trackpad (default: whichever is connected)")
    parser.add_argument("--within", type=float, default=120.0, metavar="S", help="to touch them all (default 120)")


def _add_seconds(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=float, default=10.0, help="how long (default 10); move two fingers meanwhile")


def _add_resonance(steps: Any) -> None:
    parser = _step(
        steps, "resonance", "sweep each mode on the board and propose the drive", "--port /dev/ttyACM0 --out DIR"
    )
    _add_board(parser)
    _add_sweep(parser)


def _add_modes(steps: Any) -> None:
    parser = _step(steps, "modes", "fit the vibrometer's scan of the mode shapes", "--scan scan.csv --out DIR")
    _add_scan(parser)


def _add_trackpad(steps: Any) -> None:
    parser = _step(steps, "trackpad", "find where the pad lies by touching marks on the plate", "--out DIR")
    _add_marks(parser)


def _add_latency(steps: Any) -> None:
    parser = _step(steps, "latency", "measure how far ahead the fingers must be predicted", "--out DIR --seconds 20")
    parser.add_argument("--config", type=Path, help="the service's configuration (default: DIR/hapticd.toml)")
    _add_seconds(parser)


def _add_friction(steps: Any) -> None:
    parser = _step(steps, "friction", "fit friction against amplitude", "--readings friction.csv --out DIR")
    parser.add_argument("--readings", type=Path, metavar="F.csv", help="columns amplitude_um,friction")


def _add_all(steps: Any) -> None:
    parser = _step(steps, "all", "do all steps one after the other", "--sim --out DIR")
    _add_board(parser)
    _add_sweep(parser)
    _add_scan(parser)
    _add_marks(parser)
    _add_seconds(parser)
    parser.add_argument("--readings", type=Path, metavar="F.csv", help="columns amplitude_um,friction")


def _run(options: argparse.Namespace) -> int:
    from .program import run

    return run(options)

"""The arguments of `hapticd firmware`. Light: what they set going is imported when it is called."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The subcommands, each with the arguments that name the board."""
    commands = parser.add_subparsers(title="subcommands", required=True, metavar="SUBCOMMAND")
    _command(commands, "info", "say who the board is, and how it is", "--sim", json=True)
    _command(commands, "log", "say why it was last reset, and what went wrong", "--port /dev/ttyACM0", json=True)
    _command(commands, "clear-fault", "let it leave a latched fault", "--port /dev/ttyACM0")
    _add_gains(commands)
    _add_sweep(commands)
    _add_raw(commands)
    _add_telemetry(commands)


def _command(commands: Any, name: str, summary: str, example: str, *, json: bool = False) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=summary[0].upper() + summary[1:] + ".",
        epilog=f"example: hapticd firmware {name} {example}",
    )
    where = parser.add_argument_group("the board")
    where.add_argument("--port", help="serial port, such as /dev/ttyACM0")
    where.add_argument("--baud", type=int, help="serial speed (default 921600)")
    where.add_argument("--config", type=Path, help="the service's configuration, which names port and speed")
    where.add_argument("--sim", action="store_true", help="a simulated board with a simulated plate")
    if json:
        parser.add_argument("--json", action="store_true", help="write JSON")
    parser.set_defaults(command=_run, subcommand=name)
    return parser


def _add_gains(commands: Any) -> None:
    summary = "show the control law, its gains and models, or choose them"
    parser = _command(commands, "gains", summary, "--sim --law deadbeat", json=True)
    parser.add_argument("--law", help="pi, pi_ff or deadbeat; holds until the service or a reset chooses another")
    parser.add_argument("--bandwidth", type=float, metavar="1_S", help="in 1/s (default: the firmware's own)")
    parser.add_argument("--integral-time", type=float, metavar="S", help="in seconds (default: the firmware's own)")


def _add_sweep(commands: Any) -> None:
    summary = "measure a mode: resonance, quality, gain and loop phase"
    parser = _command(commands, "sweep", summary, "--sim --mode 0 --plot mode-0.png", json=True)
    parser.add_argument("--mode", type=int, default=0, help="which, from 0 (default 0)")
    parser.add_argument("--from", dest="start_hz", type=float, metavar="HZ", help="default: 100 Hz below the drive")
    parser.add_argument("--to", dest="stop_hz", type=float, metavar="HZ", help="default: 100 Hz above the drive")
    parser.add_argument("--points", type=int, default=41, help="frequencies (default 41)")
    parser.add_argument("--dwell", type=int, default=100, metavar="MS", help="at each (default 100)")
    parser.add_argument("--volts", type=float, help="on the amplifier (default: a tenth of the board's limit)")
    parser.add_argument("--plot", type=Path, metavar="F.png", help="draw amplitude and circle")
    parser.add_argument("--save", type=Path, metavar="F.toml", help="put the mode into a calibration file")


def _add_raw(commands: Any) -> None:
    parser = _command(commands, "raw", "put a voltage on one amplifier, open loop, for a moment", "--sim --volts 10")
    parser.add_argument("--mode", type=int, default=0, help="which amplifier, from 0 (default 0)")
    parser.add_argument("--volts", type=float, required=True, help="magnitude, at most a fifth of the board's limit")
    parser.add_argument("--phase", type=float, default=0.0, metavar="DEG", help="against the drive (default 0)")
    parser.add_argument("--ms", type=int, default=500, help="for how long, at most 1000 (default 500)")


def _add_telemetry(commands: Any) -> None:
    parser = _command(commands, "telemetry", "stream control ticks as CSV", "--sim > ticks.csv", json=True)
    parser.add_argument("--rate", type=int, default=100, metavar="HZ", help="samples a second, at most (default 100)")
    parser.add_argument("--seconds", type=float, default=2.0, help="for how long (default 2)")


def _run(options: argparse.Namespace) -> int:
    from .program import run

    return run(options)

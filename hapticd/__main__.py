"""The command line. Only the module of the command that is asked for is imported: the service carries no other."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NamedTuple

from . import __version__
from .errors import HapticdError


class Command(NamedTuple):
    """`add_arguments` names the function of `module` that gives a parser its arguments, and as its default of `command`
    the function to call with them."""

    module: str
    summary: str
    example: str
    add_arguments: str = "add_arguments"


COMMANDS = {
    "demo": Command(
        "tools.demo.arguments", "run everything on the simulated plate and show it", "--seconds 10 --out demo.png"
    ),
    "run": Command("tools.run", "run the service in the foreground", "--config hapticd.toml"),
    "view": Command(
        "tools.view.arguments", "show the plate in the browser, and with --sim touch a simulated one there", "--sim"
    ),
    "simulate": Command(
        "tools.simulate",
        "play a scenario in virtual time and judge it",
        "strokes --seed 3 --json - --out strokes.npz",
    ),
    "calibrate": Command(
        "tools.calibrate.arguments",
        "measure plate, trackpad and delays step by step, each with a picture and a verdict",
        "all --sim --out DIR",
    ),
    "plate": Command(
        "tools.calibrate.arguments",
        "design a plate: pairs of modes near a frequency, their shapes, and where to glue it",
        "--size 137.5x137.5 --material glass --near 29200 --plot plate.png",
        "add_plate_arguments",
    ),
    "map": Command(
        "tools.map",
        "for a finger here, where another one can be still, or slip: a table and a picture",
        "--finger -30,20 --plot map.png",
    ),
    "record": Command(
        "tools.record.commands",
        "record a running daemon: all that it hears, decides and writes",
        "session.mcap --seconds 60",
        "add_record_arguments",
    ),
    "replay": Command(
        "tools.record.commands",
        "feed a recording through the same core: bit-identical, or the first difference",
        "session.mcap",
        "add_replay_arguments",
    ),
    "export": Command(
        "tools.record.commands",
        "turn a recording into tables for pandas, MATLAB and others",
        "session.mcap --hdf5 session.h5",
        "add_export_arguments",
    ),
    "plot": Command(
        "tools.record.commands",
        "draw a recording in the manner of the paper's figures",
        "session.mcap session.png --from 2 --to 6",
        "add_plot_arguments",
    ),
    "stream": Command(
        "tools.stream.arguments",
        "give states and metrics to PlotJuggler, Prometheus or the Lab Streaming Layer",
        "plotjuggler",
    ),
    "study": Command("tools.study.arguments", "hold the paper's study with people, and judge it", "report answers/"),
    "firmware": Command(
        "tools.firmware.arguments",
        "talk to the board: who it is, sweeps, telemetry, gains",
        "sweep --port /dev/ttyACM0 --mode 0 --save plate.toml",
    ),
    "latency": Command(
        "tools.latency.arguments",
        "measure what each part of a touch's way takes, on the devices at hand",
        "--sim --seconds 10 --ledger frames.csv",
    ),
    "bench": Command(
        "tools.bench",
        "compare the choices on a touch's path, error against run time",
        "all --json bench.json --plot bench.png",
    ),
    "doctor": Command(
        "tools.doctor.arguments", "look whether everything is there, and say what mends it", "--config hapticd.toml"
    ),
    "keys": Command(
        "tools.keys",
        "make keys for clients on other machines, and say whose are let in",
        "make /etc/hapticd/keys",
    ),
    "install-service": Command(
        "tools.install_service",
        "put the service's unit, rules, users and configuration in place",
        "--print",
    ),
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code. Errors of hapticd's own end in one sentence on stderr."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    options = parser(next((word for word in given if not word.startswith("-")), "")).parse_args(given)
    try:
        code = int(options.command(options) or 0)
        sys.stdout.flush()
        return code
    except HapticdError as error:
        print(f"hapticd: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        return _stopped_by_the_system(error)
    except KeyboardInterrupt:
        return 130


def _stopped_by_the_system(error: OSError) -> int:
    """A file that cannot be read or written, a full disk; and a reader who has seen enough, which is no error."""
    where = error.filename
    if where is None:
        if error.errno not in (errno.EPIPE, errno.ENOSPC):
            raise error
        where = "standard output"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what it holds must not be tried at the exit
    if error.errno == errno.EPIPE:
        return 0
    print(f"hapticd: {where}: {error.strerror}", file=sys.stderr)
    return 1


def parser(chosen: str = "") -> argparse.ArgumentParser:
    """All commands by name, and the arguments of the one that is `chosen`."""
    whole = argparse.ArgumentParser(
        prog="hapticd",
        description="Every finger on one vibrating glass plate gets its own friction.",
        epilog="example: hapticd view --sim\n\n`hapticd COMMAND --help` explains each, with an example.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    whole.add_argument("--version", action="version", version=f"hapticd {__version__}")
    commands = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, (module, summary, example, add_arguments) in COMMANDS.items():
        one = commands.add_parser(
            name,
            help=summary,
            description=summary[0].upper() + summary[1:] + ".",
            epilog=f"example: hapticd {name} {example}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if name == chosen:
            getattr(import_module(f".{module}", __package__), add_arguments)(one)
    return whole


if __name__ == "__main__":
    sys.exit(main())

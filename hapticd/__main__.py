"""Command line of hapticd. Only the module of the requested command is imported, so the service loads no other."""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NamedTuple

from .errors import ExitCode, HapticdError
from .tools.arguments import Parser, add_command
from .tools.outputs import check_arguments


class Command(NamedTuple):
    """One command. `add_arguments` names the function of `module` that adds the arguments to a parser, and sets its
    default `command` to the function to call with them."""

    module: str
    summary: str
    example: str
    add_arguments: str = "add_arguments"


COMMANDS = {
    "demo": Command(
        "tools.demo.program", "run everything on the simulated plate and show it", "--seconds 10 --out demo.png"
    ),
    "run": Command("tools.run", "run the service in the foreground", "--config hapticd.toml"),
    "status": Command("tools.status", "show what the running service reports of itself", "--json"),
    "view": Command(
        "tools.view.program", "show the plate in the browser, and with --sim touch a simulated one there", "--sim"
    ),
    "play": Command(
        "tools.play", "play a picture, a sound or a haptic pattern under every finger on the plate", "click.ahap --sim"
    ),
    "gateway": Command(
        "tools.gateway.program",
        "let web pages and programs without ZeroMQ be clients, by WebSocket and JSON",
        "--origin http://localhost:8000",
    ),
    "study": Command(
        "tools.study",
        "run experiments with people, by default the paper's, and analyse them",
        "report answers/",
    ),
    "calibrate": Command(
        "tools.calibrate.program",
        "measure plate, trackpad and delays step by step, each with a picture and a verdict",
        "all --sim --out DIR",
    ),
    "doctor": Command(
        "tools.doctor.program",
        "check devices, files, service and host, each with its fix; measure the delays",
        "--config hapticd.toml",
    ),
    "service": Command(
        "tools.install_service",
        "install or remove the system's service; make keys for clients on other machines",
        "install --print",
    ),
    "firmware": Command(
        "tools.firmware.program",
        "work with the board: status, sweeps, telemetry",
        "sweep --port /dev/ttyACM0 --mode 0 --plot mode-0.png",
    ),
    "plate": Command(
        "tools.plate",
        "design a plate: its modes, patches, sensors and stamps, and what fingers feel; map what it can do",
        "--size 210x210 --thickness 3 --plot plate.png",
    ),
    "record": Command(
        "tools.record.commands",
        "record a running daemon: its inputs, decisions and outputs",
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
        "turn a recording into tables for pandas, MATLAB and others, or a picture",
        "session.mcap --hdf5 session.h5",
        "add_export_arguments",
    ),
    "stream": Command(
        "tools.stream.program",
        "stream fingers, modes and markers to the Lab Streaming Layer",
        "lsl",
    ),
    "simulate": Command(
        "tools.simulate",
        "run a scenario in virtual time and score it",
        "strokes --seed 3 --json - --out strokes.npz",
    ),
    "bench": Command(
        "bench.command",
        "compare the algorithms on a touch's path, error against run time",
        "all --json bench.json",
    ),
}
GROUPS = {
    "demo": "use it",
    "calibrate": "set it up",
    "record": "record",
    "simulate": "develop",
}  # by their first command


class _Grouped(argparse.RawDescriptionHelpFormatter):
    """A command's help with a heading above the first command of each group."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog)
        self._action_max_length = 4 + max(map(len, COMMANDS))  # which argparse knows of options alone

    def _format_action(self, action: argparse.Action) -> str:
        heading = GROUPS.get(action.dest)
        return (f"\n  {heading}:\n" if heading else "") + super()._format_action(action)


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; return the exit code. An error of hapticd's own prints one sentence on stderr."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        chosen = next((word for word in given if not word.startswith("-")), "")
        options = parser(chosen).parse_args(given)
        check_arguments(options)
        code = int(options.command(options) or 0)
        sys.stdout.flush()
        return code
    except HapticdError as error:
        print(f"hapticd: {error}", file=sys.stderr)
        return error.exit_code
    except OSError as error:
        return _stopped_by_the_system(error)
    except KeyboardInterrupt:
        return ExitCode.INTERRUPTED


def _stopped_by_the_system(error: OSError) -> int:
    """Report a file that cannot be read or written, or a full disk; a closed pipe is no error."""
    where = error.filename
    if where is None:
        if error.errno not in (errno.EPIPE, errno.ENOSPC):
            raise error
        where = "standard output"
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # its buffer must not be flushed again at exit
    if error.errno == errno.EPIPE:
        return ExitCode.DONE
    print(f"hapticd: {where}: {error.strerror}", file=sys.stderr)
    return ExitCode.FAILED


class _Version(argparse.Action):
    """Print the version and exit; git is asked then only."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from .tools.version import version_text

        print(f"hapticd {version_text()}")
        parser.exit()


def parser(*chosen: str) -> argparse.ArgumentParser:
    """Return the parser of all commands, with the arguments of the `chosen` ones."""
    whole = Parser(
        prog="hapticd",
        description="Every finger on one vibrating glass plate gets its own friction.",
        epilog="example: hapticd view --sim\n\n`hapticd COMMAND --help` explains each, with an example.",
        formatter_class=_Grouped,
    )
    whole.add_argument("--version", action=_Version, nargs=0, help="show the version, of a checkout with its commit")
    commands = whole.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, (module, summary, example, add_arguments) in COMMANDS.items():
        one = add_command(commands, name, summary, example)
        if name in chosen:
            getattr(import_module(f".{module}", __package__), add_arguments)(one)
    return whole


if __name__ == "__main__":
    sys.exit(main())

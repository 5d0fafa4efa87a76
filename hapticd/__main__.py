"""The command line: `hapticd demo | run | simulate | bench | firmware | latency | keys | doctor | install-service`."""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import __version__, config
from .errors import HapticdError

STDERR = 2  # the descriptor


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code. Errors of hapticd's own end in one sentence on stderr."""
    arguments = sys.argv[1:] if arguments is None else arguments
    options = _parser(arguments).parse_args(arguments)
    try:
        return int(options.command(options) or 0)
    except HapticdError as error:
        print(f"hapticd: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 130


def _parser(arguments: Sequence[str] = ()) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="hapticd", description="Every finger on one vibrating glass plate gets its own friction."
    )
    parser.add_argument("--version", action="version", version=f"hapticd {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    if list(arguments[:1]) == ["run"]:  # the service carries nothing of the other commands in its memory
        _add_run(commands)
        return parser
    _add_demo(commands)
    _add_run(commands)
    _add_simulate(commands)
    _add_bench(commands)
    _add_firmware(commands)
    _add_latency(commands)
    _add_keys(commands)
    _add_doctor(commands)
    _add_install_service(commands)
    return parser


def _command(commands: Any, name: str, summary: str, example: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=summary[0].upper() + summary[1:] + ".",
        epilog=f"example: {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    return parser


# --- demo -------------------------------------------------------------------------------------------------------


def _add_demo(commands: Any) -> None:
    parser = _command(
        commands,
        "demo",
        "run everything on the simulated plate and show it",
        "hapticd demo --seconds 10 --out demo.png",
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="how long the fingers move (default 10)")
    parser.add_argument("--seed", type=int, default=1, help="of fingers, noise and cartography (default 1)")
    parser.add_argument("--out", type=Path, default=Path("demo.png"), help="where the picture goes (default demo.png)")
    parser.add_argument(
        "--board",
        choices=("library", "host", "qemu"),
        default="library",
        help="the firmware's core within the rig (default), or its whole program as a process or in QEMU",
    )
    parser.add_argument("--image", type=Path, metavar="FILE", help="that program (default: built by make -C firmware)")
    parser.set_defaults(command=_demo)


def _demo(options: argparse.Namespace) -> int:
    from .demo import show

    return show(options.seconds, options.seed, options.out, board=options.board, image=options.image)


# --- run --------------------------------------------------------------------------------------------------------


def _add_run(commands: Any) -> None:
    parser = _command(commands, "run", "run the service in the foreground", "hapticd run --config hapticd.toml")
    parser.add_argument("--config", type=Path, help="TOML file; without it the defaults run the simulated plate")
    parser.add_argument("--sim", action="store_true", help="take the simulated plate, whatever the configuration says")
    parser.add_argument("--print-config", action="store_true", help="print the configuration in force, and end")
    parser.add_argument("--check", action="store_true", help="read all that it names, say what is wrong, and end")
    parser.set_defaults(command=_run)


def _run(options: argparse.Namespace) -> None:
    loaded = _configuration(options)
    if options.print_config:
        print(config.render(loaded), end="")
        return
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # nothing here is large enough for numpy's threads
    from . import service

    if options.check:
        service.check(loaded)
        return
    _log_to_stderr(loaded.log.level)
    service.run(loaded, lambda: _configuration(options), judge=_check_command(options))


def _check_command(options: argparse.Namespace) -> list[str]:
    """`hapticd run --check` on what these options name."""
    config_file = [] if options.config is None else ["--config", str(options.config)]
    return [sys.executable, "-m", "hapticd", "run", "--check", *config_file, *(["--sim"] if options.sim else [])]


def _configuration(options: argparse.Namespace) -> config.Config:
    """What --config and --sim say; read anew at each call."""
    loaded = config.load(options.config) if options.config is not None else config.Config()
    return config.simulated(loaded) if options.sim else loaded


def _log_to_stderr(level: str) -> None:
    """Lines for a person at a terminal, with the time; for the journal with what it asks for."""
    from .io.journal import JournalHandler
    from .io.systemd import JournalFormatter, speaks_to_journal

    handler = JournalHandler()
    plain = logging.Formatter("%(asctime)s %(levelname)s %(message)s", "%H:%M:%S")
    handler.setFormatter(JournalFormatter() if speaks_to_journal(STDERR) else plain)
    logging.basicConfig(level=level.upper(), handlers=[handler])


# --- latency ----------------------------------------------------------------------------------------------------


def _add_latency(commands: Any) -> None:
    parser = _command(
        commands,
        "latency",
        "measure what each part of a touch's way takes, on the devices at hand",
        "hapticd latency --sim --seconds 10 --ledger frames.csv",
    )
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the simulated plate)")
    parser.add_argument("--sim", action="store_true", help="take the simulated plate, whatever the configuration says")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long (default 10); move two fingers meanwhile")
    parser.add_argument("--json", metavar="F", help="write the figures as JSON; - is standard output")
    parser.add_argument(
        "--ledger", type=Path, metavar="F.csv", help="write each frame's line: its report, ages, delays"
    )
    parser.add_argument("--plot", type=Path, metavar="F.png", help="draw the distributions")
    parser.set_defaults(command=_latency)


def _latency(options: argparse.Namespace) -> None:
    from . import latency

    loaded = _configuration(options)
    _log_to_stderr(loaded.log.level)
    latency.run(loaded, options.seconds, json_file=options.json, ledger=options.ledger, plot=options.plot)


# --- simulate ---------------------------------------------------------------------------------------------------


def _add_simulate(commands: Any) -> None:
    from .sim.scenarios import SCENARIOS

    parser = _command(
        commands,
        "simulate",
        "play a scenario in virtual time and judge it",
        "hapticd simulate strokes --seed 3 --json - --out strokes.npz\n\nscenarios:\n"
        + "\n".join(f"  {scenario.name:<16} {scenario.summary}" for scenario in SCENARIOS.values()),
    )
    parser.add_argument("scenario", choices=sorted(SCENARIOS), metavar="SCENARIO", help="see below")
    parser.add_argument("--seed", type=int, default=1, help="of fingers, noise and cartography (default 1)")
    parser.add_argument("--seconds", type=float, help="how long (default: the scenario's own)")
    parser.add_argument("--speed", type=float, default=100.0, metavar="MM_S", help="of the fingers (default 100)")
    parser.add_argument("--noise", type=float, default=0.05, metavar="MM", help="of the sensor (default 0.05)")
    parser.add_argument("--alone", action="store_true", help="leave out the paper's scheme and perfect knowledge")
    parser.add_argument("--json", metavar="F", help="write the figures as JSON; - is standard output")
    parser.add_argument("--out", type=Path, metavar="F.npz", help="write the arrays of the run")
    parser.add_argument("--plot", type=Path, metavar="F.png", help="draw it in the manner of the paper's figures")
    parser.set_defaults(command=_simulate)


def _simulate(options: argparse.Namespace) -> None:
    from .sim import lockstep, report

    settings = lockstep.Settings(speed_mm_s=options.speed, noise_mm=options.noise)
    t_start_s = time.perf_counter()
    played = lockstep.run(options.scenario, settings=settings, seed=options.seed, seconds=options.seconds)
    took_s = time.perf_counter() - t_start_s
    figures = report.figures(played, compare=not options.alone)
    print(report.table(figures), file=sys.stderr)
    print(f"{played.t_s[-1]:.1f} s of virtual time in {took_s:.2f} s", file=sys.stderr)
    if options.json is not None:
        text = json.dumps(figures, indent=2) + "\n"
        sys.stdout.write(text) if options.json == "-" else Path(options.json).write_text(text, encoding="utf-8")
    if options.out is not None:
        report.save(played, options.out)
    if options.plot is not None:
        from .sim import picture

        picture.draw_run(played, options.plot)


# --- bench ------------------------------------------------------------------------------------------------------


def _add_bench(commands: Any) -> None:
    parser = _command(
        commands,
        "bench",
        "compare the choices on a touch's path, error against run time",
        "hapticd bench all --json bench.json --plot bench.png",
    )
    parts = ("modes", "prediction", "solver", "knots", "stability", "tick", "leak", "firmware", "soak", "all")
    parser.add_argument("part", nargs="?", choices=parts, default="all", metavar="PART", help=f"{', '.join(parts)}")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each paced measurement of tick (default 2)")
    parser.add_argument("--steps", type=int, default=10_000_000, help="of stability's long walk (default 10000000)")
    parser.add_argument("--hours", type=float, default=1.0, help="of soak's virtual time (default 1); not in all")
    parser.add_argument("--json", metavar="F", help="write the figures as JSON; - is standard output")
    parser.add_argument("--plot", type=Path, metavar="F.png", help="draw error against run time")
    parser.set_defaults(command=_bench)


def _bench(options: argparse.Namespace) -> None:
    from .bench import suite

    suite.run(
        options.part,
        seconds=options.seconds,
        steps=options.steps,
        hours=options.hours,
        json_file=options.json,
        plot=options.plot,
    )


# --- firmware ---------------------------------------------------------------------------------------------------


def _add_firmware(commands: Any) -> None:
    from .bringup import arguments

    parser = _command(
        commands,
        "firmware",
        "talk to the board: who it is, sweeps, telemetry, gains",
        "hapticd firmware sweep --port /dev/ttyACM0 --mode 0 --save plate.toml",
    )
    arguments.add(parser)


# --- keys -------------------------------------------------------------------------------------------------------


def _add_keys(commands: Any) -> None:
    from . import keys

    parser = _command(
        commands,
        "keys",
        "make keys for clients on other machines, and say whose are let in",
        "hapticd keys make /etc/hapticd/keys\n"
        "         hapticd keys make . study-7\n"
        "         hapticd keys allow /etc/hapticd/keys study-7.key",
    )
    keys.add_arguments(parser)


# --- doctor -----------------------------------------------------------------------------------------------------


def _add_doctor(commands: Any) -> None:
    parser = _command(
        commands, "doctor", "look whether everything is there, and say what mends it", "hapticd doctor --config F"
    )
    parser.add_argument("--config", type=Path, help="the service's configuration (default: the built-in one)")
    parser.set_defaults(command=_doctor)


def _doctor(options: argparse.Namespace) -> int:
    from .doctor import examine

    return examine(options.config)


# --- install-service --------------------------------------------------------------------------------------------


def _add_install_service(commands: Any) -> None:
    parser = _command(
        commands,
        "install-service",
        "put the service's unit, rules, users and configuration in place",
        "hapticd install-service --print",
    )
    parser.add_argument("--print", action="store_true", help="show the files and where they go, and change nothing")
    parser.add_argument("--root", type=Path, default=Path("/"), help="install below this directory (default /)")
    parser.set_defaults(command=_install_service)


def _install_service(options: argparse.Namespace) -> None:
    from . import installation

    files = installation.service_files()
    if options.print:
        print(installation.listing(files), end="")
        return
    print(installation.install(files, options.root), end="")


if __name__ == "__main__":
    sys.exit(main())

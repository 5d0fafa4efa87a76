"""`hapticd calibrate`: arguments of all steps; each step measures, judges, draws and saves.

Without a step it prints the overview. The steps are imported when one runs, which keeps `--help` fast.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..arguments import POSITIVE, add_command, whole

if TYPE_CHECKING:
    from .verdict import Outcome, Verdict
DEFAULT_OUT = Path("calibration")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description} Without a step: the order, and the steps done so far."
    parser.epilog = f"{parser.epilog}\n         hapticd run --config DIR/hapticd.toml"
    parser.add_argument("--out", type=Path, default=DEFAULT_OUT, metavar="DIR", help="results (default calibration)")
    parser.set_defaults(command=_run, step=None)
    steps = parser.add_subparsers(title="steps", metavar="STEP")
    for name, summary, example, arguments in _STEPS:
        step = _step(steps, name, summary, example)
        for add in arguments:
            add(step)
    _add_touch(steps)


def _step(steps: Any, name: str, summary: str, example: str) -> argparse.ArgumentParser:
    parser = add_command(steps, name, summary, example)
    # Suppressed, so that the default of the parent parser remains.
    parser.add_argument("--out", type=Path, default=argparse.SUPPRESS, metavar="DIR", help="results")
    parser.add_argument("--force", action="store_true", help="overwrite files in DIR that no step wrote")
    parser.add_argument("--sim", action="store_true", help="measure the simulated plate")
    parser.add_argument("--seed", type=whole(0), default=1, help="of the simulated measurements (default 1)")
    parser.set_defaults(step=name)
    return parser


def _add_plate(parser: argparse.ArgumentParser) -> None:
    from .. import glass  # late, as are the steps

    glass.add_arguments(parser)


def _add_board(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--port", help="serial port of the board, such as /dev/ttyACM0")
    parser.add_argument("--baud", type=int, help="its speed (default 921600)")
    parser.add_argument("--config", type=Path, help="the service's configuration, which names the devices")


def _add_sweep(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--from", dest="start_hz", type=float, metavar="HZ", help="default: 100 Hz below the drive")
    parser.add_argument("--to", dest="stop_hz", type=float, metavar="HZ", help="default: 100 Hz above the drive")
    parser.add_argument("--points", type=whole(1), default=41, help="frequencies of a sweep (default 41)")
    parser.add_argument("--dwell", type=whole(1), default=100, metavar="MS", help="at each (default 100)")
    parser.add_argument("--volts", type=POSITIVE, help="on the amplifier (default: a tenth of the board's limit)")
    parser.set_defaults(mode=0)  # the sweep is planned for the first mode and repeated for the others


def _add_scan(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--scan", type=Path, metavar="FILE", help="the vibrometer's readings, CSV or NPZ")
    parser.add_argument("--size", metavar="MMxMM", help="of the plate (default 137.5x137.5, or the simulated plate's)")
    parser.add_argument(
        "--own-scale", action="store_true", help="the readings are divided by the modal amplitude: keep their scale"
    )


def _add_marks(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--marks", default="-50,-40 50,-40 50,40 -50,40", metavar="'X,Y ...'", help="on the plate in mm, 4 or more"
    )
    parser.add_argument(
        "--prints",
        default="",
        metavar="'LxW ...'",
        help="length and width in mm of the contact at each mark, or one for all, from inked prints on paper: "
        "calibrates the scale of the pad's ellipses (default: contacts are discs of solver.contact_radius_mm)",
    )
    parser.add_argument("--model", default="auto", help="of the trackpad (default: the connected one)")
    parser.add_argument(
        "--within",
        type=POSITIVE,
        default=120.0,
        metavar="S",
        help="time limit for all marks (default 120)",
    )


def _add_seconds(parser: argparse.ArgumentParser) -> None:
    what = "duration (default 10); move two fingers meanwhile"
    parser.add_argument("--seconds", type=POSITIVE, default=10.0, help=what)


def _add_latency(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--config", type=Path, help="the service's configuration (default: DIR/hapticd.toml)")
    _add_seconds(parser)


def _add_strokes(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--recording", type=Path, metavar="F.mcap", help="learn from the strokes of a recording")
    parser.add_argument(
        "--strokes", type=POSITIVE, default=60.0, metavar="S", help="duration of the strokes (default 60)"
    )


def _add_readings(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--readings", type=Path, metavar="F.csv", help="columns amplitude_um,friction, and optionally speed_mm_s"
    )


_ALL = (_add_plate, _add_board, _add_sweep, _add_scan, _add_marks, _add_seconds, _add_strokes, _add_readings)
_STEPS: tuple[tuple[str, str, str, Sequence[Callable[[argparse.ArgumentParser], None]]], ...] = (
    (
        "resonance",
        "sweep each amplifier of the board; fit modes, wires and drive",
        "--port /dev/ttyACM0 --out DIR",
        (_add_board, _add_sweep, _add_plate),
    ),
    (
        "modes",
        "fit the vibrometer's scan of the mode shapes",
        "--scan scan.csv --out DIR",
        (_add_scan, _add_plate),
    ),
    ("trackpad", "fit the pad's position from touched marks on the plate", "--out DIR", (_add_marks,)),
    ("latency", "measure the delays that the prediction must cover", "--out DIR --seconds 20", (_add_latency,)),
    ("prediction", "learn the pad's noise from a minute of strokes", "--out DIR", (_add_strokes,)),
    ("friction", "fit friction against amplitude", "--readings friction.csv --out DIR", (_add_readings,)),
    ("all", "run all steps in order", "--sim --out DIR", _ALL),
)


def _add_touch(steps: Any) -> None:
    parser = add_command(
        steps, "touch", "correct pad, sensors and map by a recording of touches", "session.mcap --out DIR"
    )
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="with record.telemetry_hz = 500")
    parser.add_argument("--out", type=Path, default=argparse.SUPPRESS, metavar="DIR", help="results")
    parser.add_argument("--force", action="store_true", help="overwrite files in DIR that no step wrote")
    parser.set_defaults(step="touch", sim=None)


def _run(options: argparse.Namespace) -> int:
    """Run one step, all steps, or print the overview; 1 if a step failed."""
    from ...files.outputs import require_matplotlib
    from . import folder
    from .verdict import Outcome

    if options.step is None:
        print(folder.overview(options.out))
        return 0
    require_matplotlib()
    steps = _steps()
    names = list(folder.STEPS) if options.step == "all" else [options.step]
    if options.sim is None:  # the recording says which plate it is of
        steps["touch"].check(options)
        options.sim = steps["touch"].is_simulated(options.recording)
    given = [value for name, value in vars(options).items() if name in ("config", "scan", "readings", "recording")]
    folder.prepare(options.out, names, given, is_simulated=options.sim, is_forced=options.force)
    for name in names:
        steps[name].check(options)  # what is wrong with the last step is said before the first
    outcomes = [_run_step(name, steps[name].run, options) for name in names]
    return 1 if Outcome.FAIL in outcomes else 0


def _steps() -> dict[str, Any]:
    """The steps' modules: `check` raises for arguments that `run` could not use."""
    from . import delays, friction, modes, prediction, resonance, touch, trackpad

    return {
        "resonance": resonance,
        "modes": modes,
        "trackpad": trackpad,
        "latency": delays,
        "prediction": prediction,
        "friction": friction,
        "touch": touch,
    }


def _run_step(name: str, run: Callable[[argparse.Namespace], Verdict], options: argparse.Namespace) -> Outcome:
    from . import folder
    from .verdict import Outcome, as_text

    verdict = folder.accepted(run(options))
    path = folder.save(options.out, verdict)
    print(as_text(verdict))
    if verdict.outcome is Outcome.FAIL:
        print(f"{path} stays without this step; its picture is {options.out / name}.png.\n")
    else:
        print(f"Settings, written to {path}:")
        print(folder.as_toml(verdict.settings), flush=True)
    return verdict.outcome

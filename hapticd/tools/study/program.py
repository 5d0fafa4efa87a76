"""`hapticd study`: arguments of its actions, and the sessions of `study run`."""

from __future__ import annotations

import argparse
import contextlib
import os
import secrets
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import to_builtins
from msgspec.structs import replace

import hapticd_client
from hapticd_client import Client

from ... import __version__
from ...config.sections import SimConfig
from ...core.friction import FrictionCurve
from ...errors import HapticdError, missing_library
from .. import glass, outputs
from ..arguments import PORT_NUMBER, add_command, add_endpoint, number, whole
from ..daemon_process import PATIENT, DaemonProcess
from ..progress import Progress
from . import own_curve, report
from .conduct import conduct
from .experiment import PAPER, StudyError, load, parse, participant_name
from .keyboard import Keyboard
from .session import MAX_SEED, SUFFIX, Session, SessionFile
from .stage import Stage

if TYPE_CHECKING:
    from .browser import Browser

SCENARIO = "virtual-finger"  # of a rehearsal: its finger explores in strokes; the virtual one is the client's own
DAEMON_WITHIN_S = 2.0
REHEARSAL_WITHIN_S = 20.0
DEFAULT_SPEED_MM_S, MAX_SPEED_MM_S = 100.0, 1000.0  # of a simulated finger
LAST_SCREEN_S = 0.5  # for the page to show its last screen
MOST_PARTS = 1000  # recordings of one participant


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "example: hapticd study run --participant P03 --out answers/\n         hapticd study report answers/"
    )
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    _add_run(actions)
    _add_report(actions)


def _add_run(actions: Any) -> None:
    parser = add_command(
        actions,
        "run",
        "run one participant's session, or continue it",
        "--participant P03 --out answers/ --browser",
        "Run one participant's session: training, then trials. Interrupted (Ctrl-C), the same command continues it. "
        "Until the last answer, neither screen nor file shows the stimuli.",
    )
    parser.add_argument("--participant", required=True, metavar="NAME", help="letters, digits, - and _, such as P03")
    parser.add_argument(
        "--out", required=True, type=Path, metavar="DIR", help="the study's folder, with a file for each participant"
    )
    parser.add_argument(
        "--protocol",
        type=Path,
        metavar="TOML",
        help="the experiment (default: the paper's, hapticd/tools/study/paper.toml)",
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="DIR",
        help="use this participant's friction curve, of `hapticd calibrate friction --participant`",
    )
    parser.add_argument(
        "--record", action="store_true", help="record the service beside the answers, as `hapticd record --now`"
    )
    parser.add_argument("--trials", type=int, metavar="N", help="another number than the experiment's")
    parser.add_argument(
        "--seed", type=whole(0, MAX_SEED), help="of the trials' order (default: a random one, kept in the file)"
    )
    parser.add_argument(
        "--browser", action="store_true", help="ask on a page in this machine's browser, not in the terminal"
    )
    parser.add_argument(
        "--page-port", type=PORT_NUMBER, default=0, metavar="PORT", help="of that page (default: any free one)"
    )
    add_endpoint(parser)
    parser.add_argument("--sim", action="store_true", help="rehearse on a simulated plate with a scripted finger")
    glass.add_arguments(parser)
    simulated = parser.add_argument_group("a simulated participant")
    simulated.add_argument("--simulate", action="store_true", help="answer by a simulated participant, in virtual time")
    simulated.add_argument("--scheme", choices=("hapticd", "paper"), help="the control scheme (default hapticd)")
    simulated.add_argument(
        "--speed", type=number(0.0, MAX_SPEED_MM_S, is_above=True), metavar="MM_S", help="of its finger (default 100)"
    )
    parser.set_defaults(command=run_session)


def _add_report(actions: Any) -> None:
    parser = add_command(
        actions,
        "report",
        "analyse all finished sessions of a folder",
        "answers/ --json -",
        "Success rates, their average and standard deviation, tests against guessing. Writes results.csv, trials.csv "
        "and figure-12.png to the folder. Unfinished sessions stay blind.",
    )
    parser.add_argument("folder", type=Path, metavar="DIR", help="the --out of the sessions")
    outputs.add_json(parser)
    parser.add_argument("--bids", type=Path, metavar="DIR", help="folder for all trials, under BIDS names")
    outputs.add_file(parser, "--parquet", outputs.PARQUET, metavar="F.parquet", help="and to one Parquet file")
    parser.set_defaults(command=_report)


def _report(options: argparse.Namespace) -> None:
    report.write(options.folder, options.json, bids=options.bids, parquet=options.parquet, is_forced=options.force)


def rehearsal(scenario: str = SCENARIO, plate: SimConfig | None = None, settings: str = "") -> DaemonProcess:
    """Return a service on a simulated plate with these settings, which logs only errors to the study's terminal."""
    sim = f'scenario = "{scenario}"\n{glass.lines(plate or SimConfig())}'
    return DaemonProcess(sim, PATIENT + settings, log_level="error")


def run_session(options: argparse.Namespace) -> None:
    """Run the session, or continue it. Raises StudyError for conflicting options, HapticdError without a daemon;
    earlier answers are kept."""
    _check(options)
    given = _given(options)
    path = options.out / f"{given.participant}{SUFFIX}"
    with SessionFile(path, given) as file:
        _check_same(options, file.session, given, path)
        if file.session.is_over:
            raise StudyError(f"{path}: this session is over: see `hapticd study report {options.out}`.")
        try:
            _simulate(file, given) if options.simulate else _ask(options, file, path)
        except KeyboardInterrupt:
            print(f"\n{_progress(file.session)} answers in {path}: the same command continues it.")
            raise
    print(f"{_progress(file.session)} answers in {path}; then: hapticd study report {options.out}")


def _progress(session: Session) -> str:
    return f"{len(session.answers)} of {session.experiment.trials}"


def _check(options: argparse.Namespace) -> None:
    if not options.simulate and (options.scheme is not None or options.speed is not None):
        raise StudyError("--scheme and --speed need a simulated participant: give --simulate as well.")
    if options.simulate and options.calibration is not None:
        raise StudyError("--simulate has a finger of its own: it cannot be combined with --calibration.")
    if options.simulate and (options.browser or options.endpoint is not None):
        raise StudyError(
            "--simulate uses neither service nor page: it cannot be combined with --browser or --endpoint."
        )
    if options.simulate and options.record:
        raise StudyError("--simulate has no service to record: omit --record.")
    if options.page_port != 0 and not options.browser:
        raise StudyError("--page-port needs the page: give --browser as well.")
    glass.chosen(options, is_simulated=options.sim)
    if options.sim and options.endpoint is not None:
        raise StudyError("--sim starts a service of its own: it cannot be combined with --endpoint.")


def _given(options: argparse.Namespace) -> Session:
    """Return the session of a new file."""
    experiment = load(options.protocol or PAPER)
    if options.trials is not None:
        experiment = parse({**to_builtins(experiment), "trials": options.trials})
    about: dict[str, object] = {"hapticd": __version__, "begun": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
    if options.calibration is not None:
        about[own_curve.KEY] = own_curve.measured(options.calibration, participant_name(options.participant))
    if options.simulate:
        speed_mm_s = DEFAULT_SPEED_MM_S if options.speed is None else options.speed
        about |= {"simulated": "participant", "scheme": options.scheme or "hapticd", "speed_mm_s": speed_mm_s}
    seed = secrets.randbelow(2**32) if options.seed is None else options.seed
    return Session(participant_name(options.participant), seed, experiment, about=about)


def _check_same(options: argparse.Namespace, session: Session, given: Session, path: Path) -> None:
    """Check that the options do not change a continued session."""
    if (session.simulated == "participant") != options.simulate:
        who, same = ("a person", "without") if options.simulate else ("a simulated participant", "with")
        raise StudyError(f"{path}: was started by {who}: continue {same} --simulate.")
    for name in ("scheme", "speed_mm_s"):
        value = session.about.get(name)
        if value != given.about.get(name):
            raise StudyError(
                f"{path}: was started with {name} = {value}, not {given.about.get(name)}: continue with the same."
            )
    if session.participant != given.participant:
        raise StudyError(f"{path}: is {session.participant}'s session: check the file's name.")
    if options.trials is not None and options.trials != session.experiment.trials:
        raise StudyError(f"{path}: was started with {session.experiment.trials} trials: omit --trials to continue it.")
    asked = replace(given.experiment, trials=session.experiment.trials)
    if options.protocol is not None and asked != session.experiment:
        raise StudyError(f"{path}: was started with another experiment: continue with the same --protocol.")
    if options.seed is not None and options.seed != session.seed:
        raise StudyError(f"{path}: was started with another seed: omit --seed to continue it.")


def _simulate(file: SessionFile, given: Session) -> None:
    from .simulated import SimulatedParticipant

    about, trials = given.about, file.session.experiment.trials
    with Progress("simulated trials") as progress:
        participant = SimulatedParticipant(file.session, about["scheme"], speed_mm_s=about["speed_mm_s"])
        for answer in participant.answers():
            file.append(answer)
            progress(answer.trial / trials)
    file.end()


def _ask(options: argparse.Namespace, file: SessionFile, path: Path) -> None:
    """Run the session with a person, on the plate."""
    with contextlib.ExitStack() as held:
        held.callback(signal.signal, signal.SIGTERM, signal.signal(signal.SIGTERM, signal.default_int_handler))
        about, simulated = file.session.about, None
        if options.sim:
            simulated = held.enter_context(rehearsal(plate=glass.chosen(options), settings=own_curve.settings(about)))
        try:
            client = held.enter_context(_client(options, simulated))
            plate = client.plate()
            file.mark_simulated_plate(path, is_simulated=bool(plate.get("simulated")))
            stage = Stage(client, file.session.experiment, _converting(options, file.session, plate))
            if options.record:
                held.enter_context(client.record(_recording(path)))
            if not options.browser:
                conduct(file, stage, held.enter_context(Keyboard(sys.stdout)), time)
                return
            page = held.enter_context(_browser(options.page_port))
            print(f"open {page.url}", flush=True)
            conduct(file, stage, page, time)
            time.sleep(LAST_SCREEN_S)
        except hapticd_client.HapticdError as error:
            raise HapticdError(f"{error} The answers are kept: continue with the same command.") from None


def _browser(port: int) -> Browser:
    """Return the panel on a page. Raises HapticdError without aiohttp."""
    try:
        from .browser import Browser
    except ImportError:
        raise missing_library("The page needs aiohttp", "study") from None
    return Browser(port)


def _converting(options: argparse.Namespace, session: Session, plate: Mapping[str, Any]) -> FrictionCurve | None:
    """Return the participant's curve where the service has another one, and say so."""
    curve = own_curve.of_session(session.about)
    if curve is None or own_curve.is_served(curve, plate):
        return None
    path = own_curve.path_of(options.calibration or Path("DIR"), session.participant)
    print(own_curve.ANOTHER.format(participant=session.participant, path=path), file=sys.stderr, flush=True)
    return curve


def _recording(path: Path) -> Path:
    """Return a new recording's path next to the session's file: one for each part of an interrupted session."""
    names = (path.with_suffix(".mcap"), *(path.with_suffix(f".{number}.mcap") for number in range(2, MOST_PARTS)))
    return next((one for one in names if not one.exists()), names[-1])


def _client(options: argparse.Namespace, simulated: DaemonProcess | None) -> Client:
    name = f"study-{os.getpid()}"  # unique, so that a second study on the plate is refused
    if simulated is None:
        return Client(options.endpoint, name=name, timeout_s=DAEMON_WITHIN_S)
    return Client(simulated.runtime_dir, name=name, timeout_s=REHEARSAL_WITHIN_S)

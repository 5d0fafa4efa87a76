"""`hapticd-study`, or `hapticd study`: arguments of its actions, and the sessions of `run`."""

from __future__ import annotations

import argparse
import contextlib
import os
import secrets
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from msgspec import to_builtins
from msgspec.structs import replace

from hapticd_client import Client, HapticdError, RefusedError

from . import __version__
from .conduct import conduct
from .experiment import PAPER, StudyError, load, parse, participant_name
from .keyboard import Keyboard
from .rehearsal import Rehearsal
from .session import MAX_SEED, SUFFIX, Session, SessionFile
from .stage import Stage

DAEMON_WITHIN_S = 2.0
REHEARSAL_WITHIN_S = 60.0
LAST_SCREEN_S = 0.5  # for the page to show its last screen
MAX_PARTS = 1000  # recordings of one participant
FAILED, INTERRUPTED = 1, 130  # exit codes, as of hapticd


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code. An error prints one sentence on stderr."""
    parser = argparse.ArgumentParser(
        prog="hapticd-study", description="Run experiments with people, by default the paper's, and analyse them."
    )
    add_arguments(parser)
    options = parser.parse_args(arguments)
    return int(options.command(options))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the actions; their default `command` takes the options and returns the exit code."""
    parser.epilog = f"example: {parser.prog} run --participant P03 --out answers/"
    actions = parser.add_subparsers(title="actions", required=True, metavar="ACTION")
    _add_run(actions)
    _add_report(actions)


def _add_run(actions: Any) -> None:
    parser = actions.add_parser(
        "run",
        help="run one participant's session, or continue it",
        description="Run one participant's session: training, then trials. Interrupted (Ctrl-C), the same command "
        "continues it. Until the last answer, neither screen nor file shows the stimuli.",
    )
    parser.epilog = f"example: {parser.prog} --participant P03 --out answers/ --browser"
    add = parser.add_argument
    add("--participant", required=True, metavar="NAME", help="letters, digits, - and _, such as P03")
    add("--out", required=True, type=Path, metavar="DIR", help="the study's folder, with a file for each participant")
    add("--protocol", type=Path, metavar="TOML", help="the experiment (default: the paper's)")
    add("--record", action="store_true", help="record the service beside the answers")
    add("--trials", type=int, metavar="N", help="another number than the experiment's")
    add("--seed", type=int, metavar="N", help="of the trials' order (default: a random one, kept in the file)")
    add("--browser", action="store_true", help="ask on a page in this machine's browser, not in the terminal")
    add("--page-port", type=int, default=0, metavar="PORT", help="of that page (default: any free one)")
    add("--endpoint", metavar="DIR", help="the service's runtime directory (default: found)")
    add("--sim", action="store_true", help="rehearse on a simulated plate with a scripted finger")
    parser.set_defaults(command=partial(_reported, run_session))


def _add_report(actions: Any) -> None:
    parser = actions.add_parser(
        "report",
        help="analyse all finished sessions of a folder",
        description="Success rates, their average and standard deviation, tests against guessing; thresholds; ratings. "
        "Writes results.csv, trials.csv and figure-12.png to the folder. Unfinished sessions stay blind.",
    )
    parser.epilog = f"example: {parser.prog} answers/ --json -"
    parser.add_argument("folder", type=Path, metavar="DIR", help="the --out of the sessions")
    parser.add_argument("--json", metavar="F", help="write the figures as JSON; - is standard output")
    parser.add_argument("--force", action="store_true", help="overwrite existing output files")
    parser.set_defaults(command=partial(_reported, _report))


def _reported(action: Callable[[argparse.Namespace], None], options: argparse.Namespace) -> int:
    """Run an action; return its exit code, with an error as one sentence on stderr."""
    try:
        action(options)
    except HapticdError as error:
        print(f"hapticd-study: {error}", file=sys.stderr)
        return error.exit_code if isinstance(error, StudyError) else FAILED
    except KeyboardInterrupt:
        return INTERRUPTED
    except OSError as error:
        print(f"hapticd-study: {error.filename or 'standard output'}: {error.strerror}", file=sys.stderr)
        return FAILED
    return 0


def _report(options: argparse.Namespace) -> None:
    from . import report  # matplotlib takes a second

    report.write(options.folder, options.json, is_forced=options.force)


def run_session(options: argparse.Namespace) -> None:
    """Run the session, or continue it. Raises StudyError for conflicting options, HapticdError without a daemon;
    earlier answers are kept."""
    if options.page_port != 0 and not options.browser:
        raise StudyError("--page-port needs the page: give --browser as well.")
    if options.sim and options.endpoint is not None:
        raise StudyError("--sim starts a service of its own: it cannot be combined with --endpoint.")
    given = _given(options)
    path = options.out / f"{given.participant}{SUFFIX}"
    with SessionFile(path, given) as file:
        _check_same(options, file.session, given, path)
        if file.session.is_over:
            raise StudyError(f"{path}: this session is over: see `hapticd-study report {options.out}`.")
        try:
            _ask(options, file, path)
        except KeyboardInterrupt:
            print(f"\n{_progress(file.session)} answers in {path}: the same command continues it.")
            raise
    print(f"{_progress(file.session)} answers in {path}; then: hapticd-study report {options.out}")


def _progress(session: Session) -> str:
    return f"{len(session.answers)} of {session.experiment.trials}"


def _given(options: argparse.Namespace) -> Session:
    """Return the session of a new file."""
    experiment = load(options.protocol or PAPER)
    if options.trials is not None:
        experiment = parse({**to_builtins(experiment), "trials": options.trials})
    participant = participant_name(options.participant)
    about: dict[str, object] = {"hapticd_study": __version__, "begun": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
    seed = secrets.randbelow(2**32) if options.seed is None else options.seed
    if not 0 <= seed <= MAX_SEED:
        raise StudyError(f"--seed: {seed} is out of bounds, it must be 0 .. {MAX_SEED}.")
    return Session(participant, seed, experiment, about=about)


def _check_same(options: argparse.Namespace, session: Session, given: Session, path: Path) -> None:
    """Check that the options do not change a continued session."""
    if session.participant != given.participant:
        raise StudyError(f"{path}: is {session.participant}'s session: check the file's name.")
    if options.trials is not None and options.trials != session.experiment.trials:
        raise StudyError(f"{path}: was started with {session.experiment.trials} trials: omit --trials to continue it.")
    asked = replace(given.experiment, trials=session.experiment.trials)
    if options.protocol is not None and asked != session.experiment:
        raise StudyError(f"{path}: was started with another experiment: continue with the same --protocol.")
    if options.seed is not None and options.seed != session.seed:
        raise StudyError(f"{path}: was started with another seed: omit --seed to continue it.")


def _ask(options: argparse.Namespace, file: SessionFile, path: Path) -> None:
    """Run the session with a person, on the plate."""
    with contextlib.ExitStack() as held:
        held.callback(signal.signal, signal.SIGTERM, signal.signal(signal.SIGTERM, signal.default_int_handler))
        endpoint, within_s = options.endpoint, DAEMON_WITHIN_S
        if options.sim:
            endpoint = held.enter_context(Rehearsal()).runtime_dir
            within_s = REHEARSAL_WITHIN_S
        try:
            # The name is unique, so that a second study on the plate is refused.
            client = held.enter_context(Client(endpoint, name=f"study-{os.getpid()}", timeout_s=within_s))
            file.mark_simulated_plate(path, is_simulated=bool(client.plate().get("simulated")))
            _take_person(client, file.session.participant)
            stage = Stage(client, file.session.experiment)
            if options.record:
                held.enter_context(client.record(_recording(path)))
            if not options.browser:
                conduct(file, stage, held.enter_context(Keyboard(sys.stdout)), time)
                return
            from .browser import Browser  # aiohttp takes half a second

            page = held.enter_context(Browser(options.page_port))
            print(f"open {page.url}", flush=True)
            conduct(file, stage, page, time)
            time.sleep(LAST_SCREEN_S)
        except StudyError:
            raise
        except HapticdError as error:
            raise HapticdError(f"{error} The answers are kept: continue with the same command.") from None


def _take_person(client: Client, participant: str) -> None:
    """Let the plate have the participant's friction curve, where one was measured, else no other participant's."""
    try:
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always")
            client.person(participant)
        for note in notes:  # of an old curve
            print(note.message, file=sys.stderr)
    except RefusedError as error:
        print(f"{error} The plate's own friction curve is used.", file=sys.stderr)
        with contextlib.suppress(RefusedError):  # of an older daemon
            client.person(None)


def _recording(path: Path) -> Path:
    """Return a new recording's path next to the session's file: one for each part of an interrupted session."""
    names = (path.with_suffix(".mcap"), *(path.with_suffix(f".{number}.mcap") for number in range(2, MAX_PARTS)))
    return next((one for one in names if not one.exists()), names[-1])


if __name__ == "__main__":
    sys.exit(main())

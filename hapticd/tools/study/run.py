"""`hapticd study run`: from what was asked on the command line to a session held."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ... import __version__
from ...errors import HapticdError
from .browser import Browser
from .conduct import conduct
from .keyboard import Keyboard
from .protocol import Design, StudyError, participant_name
from .rehearsal import rehearsal
from .session import MAX_SEED, SUFFIX, Session, SessionFile
from .stage import Stage

if TYPE_CHECKING:
    from hapticd_client import Client

    from ..daemon_process import DaemonProcess

DAEMON_WITHIN_S = 2.0
REHEARSAL_WITHIN_S = 20.0
MAX_PORT = 65535
MAX_SPEED_MM_S = 1000.0  # of a simulated finger
LAST_LOOK_S = 0.5  # for the page to show its last screen


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the command line says; None: not said."""

    participant: str
    folder: Path
    trials: int | None = None
    seed: int | None = None
    endpoint: str | None = None
    sim: bool = False
    browser: bool = False
    page_port: int = 0
    simulate: bool = False
    scheme: str | None = None
    speed_mm_s: float | None = None


def hold(wishes: Wishes) -> None:
    """Hold the session, or go on with it. Raises StudyError for wishes that do not go together, HapticdError where
    the plate does not answer: what was answered before is kept."""
    _check(wishes)
    given = _given(wishes)
    path = wishes.folder / f"{given.participant}{SUFFIX}"
    with SessionFile(path, given) as file:
        _check_same(wishes, file.session, given, path)
        if file.session.is_over:
            raise StudyError(f"{path}: this session is over: see `hapticd study report {wishes.folder}`.")
        try:
            _simulate(wishes, file) if wishes.simulate else _ask(wishes, file)
        except KeyboardInterrupt:
            print(f"\n{_progress(file.session)} answers in {path}: the same command goes on with it.")
            raise
    print(f"{_progress(file.session)} answers in {path}; then: hapticd study report {wishes.folder}")


def _progress(session: Session) -> str:
    return f"{len(session.answers)} of {session.design.trials}"


def _check(wishes: Wishes) -> None:
    if not wishes.simulate and (wishes.scheme is not None or wishes.speed_mm_s is not None):
        raise StudyError("--scheme and --speed are a simulated participant's: give --simulate as well.")
    if wishes.simulate and (wishes.browser or wishes.endpoint is not None):
        raise StudyError("--simulate plays in virtual time, without a service or a page: leave --browser, --endpoint.")
    if wishes.speed_mm_s is not None and not 0 < wishes.speed_mm_s <= MAX_SPEED_MM_S:
        raise StudyError(f"--speed: {wishes.speed_mm_s:g} is out of bounds, give 0 .. {MAX_SPEED_MM_S:g} mm/s.")
    if wishes.page_port != 0 and not wishes.browser:
        raise StudyError("--page-port is of the page: give --browser as well.")
    if wishes.sim and wishes.endpoint is not None:
        raise StudyError("--sim starts a service of its own: leave --endpoint.")
    if wishes.seed is not None and not 0 <= wishes.seed <= MAX_SEED:
        raise StudyError(f"--seed: {wishes.seed} is out of bounds, give 0 .. {MAX_SEED}.")
    if not 0 <= wishes.page_port <= MAX_PORT:
        raise StudyError(f"--page-port: {wishes.page_port} is out of bounds, give 0 .. {MAX_PORT}.")


def _given(wishes: Wishes) -> Session:
    """The session as it would begin."""
    design = Design() if wishes.trials is None else Design(trials=wishes.trials)
    about: dict[str, object] = {"hapticd": __version__, "begun": time.strftime("%Y-%m-%dT%H:%M:%S%z")}
    if wishes.simulate:
        about |= {"simulated": True, "scheme": _scheme(wishes), "speed_mm_s": _speed_mm_s(wishes)}
    seed = secrets.randbelow(2**32) if wishes.seed is None else wishes.seed
    return Session(participant_name(wishes.participant), seed, design, about=about)


def _check_same(wishes: Wishes, session: Session, given: Session, path: Path) -> None:
    """Who goes on with a session cannot change it."""
    begun = {name: session.about.get(name) for name in ("simulated", "scheme", "speed_mm_s")}
    for name, value in begun.items():
        if value != given.about.get(name):
            raise StudyError(
                f"{path}: was begun with {name} = {value}, not {given.about.get(name)}: go on as it began."
            )
    if session.participant != given.participant:
        raise StudyError(f"{path}: is {session.participant}'s session: was the file renamed?")
    if wishes.trials is not None and wishes.trials != session.design.trials:
        raise StudyError(f"{path}: was begun with {session.design.trials} trials: leave --trials to go on with it.")
    if wishes.seed is not None and wishes.seed != session.seed:
        raise StudyError(f"{path}: was begun with another seed: leave --seed to go on with it.")


def _simulate(wishes: Wishes, file: SessionFile) -> None:
    from .simulated import SimulatedParticipant

    participant = SimulatedParticipant(file.session, _scheme(wishes), speed_mm_s=_speed_mm_s(wishes))
    for answer in participant.answers():
        file.append(answer)
    file.end()


def _ask(wishes: Wishes, file: SessionFile) -> None:
    """Ask a person, on the plate."""
    try:
        import hapticd_client
    except ImportError:
        raise HapticdError("The study is a client: install it with `pip install clients/python`.") from None
    with contextlib.ExitStack() as held:
        held.callback(signal.signal, signal.SIGTERM, signal.signal(signal.SIGTERM, signal.default_int_handler))
        simulated = held.enter_context(rehearsal()) if wishes.sim else None
        try:
            stage = Stage(held.enter_context(_client(wishes, simulated)), file.session.design)
            if not wishes.browser:
                conduct(file, stage, held.enter_context(Keyboard(sys.stdout)), time)
                return
            page = held.enter_context(Browser(wishes.page_port))
            print(f"open {page.url}", flush=True)
            conduct(file, stage, page, time)
            time.sleep(LAST_LOOK_S)
        except hapticd_client.HapticdError as error:
            raise HapticdError(f"{error} What was answered is kept: go on with the same command.") from None


def _client(wishes: Wishes, simulated: DaemonProcess | None) -> Client:
    from hapticd_client import Client

    name = f"study-{os.getpid()}"  # a second study on one plate is refused, and does not change this one's trials
    if simulated is None:
        return Client(wishes.endpoint, name=name, timeout_s=DAEMON_WITHIN_S)
    return Client(simulated.runtime_dir, name=name, timeout_s=REHEARSAL_WITHIN_S)


def _scheme(wishes: Wishes) -> str:
    return "hapticd" if wishes.scheme is None else wishes.scheme


def _speed_mm_s(wishes: Wishes) -> float:
    return 100.0 if wishes.speed_mm_s is None else wishes.speed_mm_s

"""Session of one participant: training, trials with a rest before each, pauses, and the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from . import panel
from .experiment import Intervals
from .order import Trial, examples, practised
from .panel import NEXT, PAUSE, StudyPanel
from .session import Answer, Session, SessionFile
from .stage import Stage

LEAST_TOUCH_S = 0.3  # before an answer counts
ADVICE_STEP_MM_S = 5  # finer steps would flicker
FAST_MM_S = 100.0  # the paper's 10 cm/s, at which its positions lagged 1.5 mm


class Clock(Protocol):
    """Time source of a session; tests pass their own."""

    def monotonic(self) -> float:
        """Return monotonic seconds."""

    def time(self) -> float:
        """Return seconds since 1970."""


def conduct(file: SessionFile, stage: Stage, shown: StudyPanel, clock: Clock) -> None:
    """Run the session to its end. An exception may end it at any time: given answers are kept."""
    made, name = file.session.experiment, file.session.participant
    if file.session.answers:
        _pause(file, stage, shown)
    else:
        if made.training:
            _train(file.session, stage, shown)
        _practise(file.session, stage, shown, clock)
    stage.mark(f"study {name} begins")
    while not file.session.is_complete:
        number = len(file.session.answers) + 1
        heading = panel.numbered(number, made.trials)
        if made.break_after and number > 1 and (number - 1) % made.break_after == 0:
            _pause(file, stage, shown)
        stage.mark(f"study {name} trial {number} start")
        trial = file.session.presented[number - 1]
        answer = _try(file.session, trial, number, heading, stage, shown, clock)
        stage.rest()
        if answer is None:
            _pause(file, stage, shown)
            continue
        file.append(answer)
        stage.mark(f"study {name} trial {number} answer {answer.answer}")
        if made.feedback:
            _grade(trial, answer, heading, stage, shown)
    file.end()
    stage.mark(f"study {name} ends")
    shown.show(panel.over(made.trials))


def _train(session: Session, stage: Stage, shown: StudyPanel) -> None:
    """Present the stimuli of the answers by name, as often as the participant chooses."""
    made = session.experiment
    levels = examples(made) if made.correct else {}
    key = next(iter(made.choices))
    while key != NEXT:
        shown.show(panel.training(made, key))
        if key in levels:
            stage.present(levels[key])
        key = _wait(stage, shown, lambda: _advice(stage))
    stage.rest()


def _practise(session: Session, stage: Stage, shown: StudyPanel, clock: Clock) -> None:
    """Run trials that are not kept, each with feedback; a pause begins it once more."""
    trials = practised(session.experiment, session.seed)
    for number, trial in enumerate(trials, 1):
        heading = panel.numbered(number, len(trials), is_practice=True)
        answer = None
        while answer is None:
            answer = _try(session, trial, number, heading, stage, shown, clock)
            stage.rest()
        _grade(trial, answer, heading, stage, shown)


def _try(
    session: Session, trial: Trial, number: int, heading: str, stage: Stage, shown: StudyPanel, clock: Clock
) -> Answer | None:
    """Run one trial after a rest; return None if it was interrupted."""
    made = session.experiment
    _rest(stage, shown, panel.between(heading), clock, made.rest_s)
    t_start_s = clock.monotonic()
    if made.intervals is None:
        stage.present(trial.levels)
    elif not _feel_both(session, trial, made.intervals, heading, stage, shown, clock):
        return None
    shown.show(panel.trial(made, heading))
    while True:
        key = _wait(stage, shown, lambda: "")
        if key == PAUSE:
            return None
        if stage.touch.touched_s >= LEAST_TOUCH_S:
            break
        shown.note("Touch the plate first.")
    return Answer(
        trial=number,
        answer=key,
        t_unix_s=clock.time(),
        took_s=clock.monotonic() - t_start_s,
        touched_s=stage.touch.touched_s,
        speed_mm_s=stage.touch.speed_mm_s,
        limited_frac=stage.touch.limited_frac,
        felt_friction=stage.touch.felt_friction,
        pressure_frac=stage.touch.pressure_frac,
        t_daemon_ns=stage.touch.t_daemon_ns,
    )


def _feel_both(
    session: Session,
    trial: Trial,
    intervals: Intervals,
    heading: str,
    stage: Stage,
    shown: StudyPanel,
    clock: Clock,
) -> bool:
    """Present both intervals, each until it was touched long enough; return whether no one paused."""
    standard = {**trial.levels, intervals.of: intervals.standard}
    order = (standard, trial.levels) if trial.is_standard_first else (trial.levels, standard)
    what = heading.partition(" of ")[0].lower()  # "trial 3", or "practice 1"
    for which, levels in zip(session.experiment.choices, order, strict=True):
        if which == "second":
            _rest(stage, shown, panel.between(heading), clock, intervals.pause_s)
        stage.present(levels)
        stage.mark(f"study {session.participant} {what} interval {which}")
        shown.show(panel.interval(heading, which))
        while stage.touch.touched_s < intervals.touched_s:
            if shown.pressed() == PAUSE:
                return False
            stage.step()
    touch = stage.touch
    stage.rest()
    stage.touch = touch  # of the second interval, for the answer
    return True


def _rest(stage: Stage, shown: StudyPanel, screen: panel.Screen, clock: Clock, rest_s: float) -> None:
    stage.rest()
    shown.show(screen)
    t_end_s = clock.monotonic() + rest_s
    while clock.monotonic() < t_end_s:
        stage.step()


def _pause(file: SessionFile, stage: Stage, shown: StudyPanel) -> None:
    shown.show(panel.paused(len(file.session.answers), file.session.experiment.trials))
    _wait(stage, shown, lambda: "")


def _grade(trial: Trial, answer: Answer, heading: str, stage: Stage, shown: StudyPanel) -> None:
    shown.show(panel.graded(heading, is_right=answer.answer == trial.correct))
    _wait(stage, shown, lambda: "")


def _wait(stage: Stage, shown: StudyPanel, advice: Callable[[], str]) -> str:
    """Step until a key of the screen is pressed; return it."""
    while (key := shown.pressed()) is None:
        stage.step()
        if remark := advice():
            shown.note(remark)
    return key


def _advice(stage: Stage) -> str:
    """Return advice on the speed: participants learn not to move too fast, as in the paper."""
    speed_mm_s = ADVICE_STEP_MM_S * round(stage.touch.recent_mm_s / ADVICE_STEP_MM_S)
    if speed_mm_s == 0:
        return "  0 mm/s, move your finger"
    return f"{speed_mm_s:3.0f} mm/s, {'too fast: slower' if speed_mm_s > FAST_MM_S else 'a good speed'}"

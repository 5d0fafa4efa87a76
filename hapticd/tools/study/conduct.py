"""Session of one participant: training, trials with a rest before each, pauses, and the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from . import panel
from .panel import PanelKey, StudyPanel
from .protocol import FrictionLevel
from .session import Answer, SessionFile
from .stage import Stage

REST_S = 1.0
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
    trials = file.session.design.trials
    if file.session.answers:
        _pause(file, stage, shown)
    else:
        _train(stage, shown)
    stage.mark(f"study {file.session.participant} begins")
    while not file.session.is_complete:
        number = len(file.session.answers) + 1
        _rest(stage, shown, panel.between(number, trials), clock)
        answer = _try(file, stage, shown, clock, number)
        stage.rest()
        if answer is None:
            _pause(file, stage, shown)
        else:
            file.append(answer)
            stage.mark(f"study {file.session.participant} trial {number} answer {answer.answer}")
    file.end()
    stage.mark(f"study {file.session.participant} ends")
    shown.show(panel.over(trials))


def _train(stage: Stage, shown: StudyPanel) -> None:
    """Present either friction by name, as often as the participant chooses."""
    key = PanelKey.HIGH
    while key is not PanelKey.NEXT:
        shown.show(panel.training(key))
        stage.present(FrictionLevel(key))
        key = _wait(stage, shown, lambda: _advice(stage))
    stage.rest()


def _try(file: SessionFile, stage: Stage, shown: StudyPanel, clock: Clock, number: int) -> Answer | None:
    """Run one trial; return None if it was interrupted."""
    session = file.session
    stage.mark(f"study {session.participant} trial {number} start")
    t_start_s = clock.monotonic()
    stage.present(session.presented[number - 1])
    shown.show(panel.trial(number, session.design.trials))
    while True:
        key = _wait(stage, shown, lambda: "")
        if key is PanelKey.PAUSE:
            return None
        if stage.touch.touched_s >= LEAST_TOUCH_S:
            break
        shown.note("Touch the plate first.")
    return Answer(
        trial=number,
        answer=FrictionLevel(key),
        t_unix_s=clock.time(),
        took_s=clock.monotonic() - t_start_s,
        touched_s=stage.touch.touched_s,
        speed_mm_s=stage.touch.speed_mm_s,
        limited_frac=stage.touch.limited_frac,
    )


def _rest(stage: Stage, shown: StudyPanel, screen: panel.Screen, clock: Clock) -> None:
    stage.rest()
    shown.show(screen)
    t_end_s = clock.monotonic() + REST_S
    while clock.monotonic() < t_end_s:
        stage.step()


def _pause(file: SessionFile, stage: Stage, shown: StudyPanel) -> None:
    shown.show(panel.paused(len(file.session.answers), file.session.design.trials))
    _wait(stage, shown, lambda: "")


def _wait(stage: Stage, shown: StudyPanel, advice: Callable[[], str]) -> PanelKey:
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

"""Session of one participant: training, trials with a rest before each, pauses, and the end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from . import panel
from .order import Trial, examples, practised
from .panel import NEXT, PAUSE, Screen, StudyPanel
from .session import Answer, SessionFile
from .stage import Stage

LEAST_TOUCH_S = 0.3  # before an answer counts
ADVICE_STEP_MM_S = 5  # finer steps would flicker
FAST_MM_S = 100.0  # the paper's 10 cm/s, at which its positions lagged 1.5 mm


class Clock(Protocol):
    """Time source of a session: monotonic seconds, and seconds since 1970."""

    def monotonic(self) -> float: ...

    def time(self) -> float: ...


def conduct(file: SessionFile, stage: Stage, shown: StudyPanel, clock: Clock) -> None:
    """Run the session to its end. An exception may end it at any time: given answers are kept."""
    _Conductor(file, stage, shown, clock).run()


@dataclass(frozen=True, slots=True)
class _Conductor:
    file: SessionFile
    stage: Stage
    shown: StudyPanel
    clock: Clock

    def run(self) -> None:
        made, name = self.file.session.experiment, self.file.session.participant
        if self.file.session.answers:
            self._pause()
        else:
            if made.training:
                self._train()
            self._practise()
        self.stage.mark(f"study {name} begins")
        while not self.file.session.is_complete:
            number = len(self.file.session.answers) + 1
            heading = f"Trial {number} of {made.trials}"
            if made.break_after and number > 1 and (number - 1) % made.break_after == 0:
                self._pause()
            self.stage.mark(f"study {name} trial {number} start")
            trial = self.file.session.presented[number - 1]
            answer = self._try(trial, number, heading)
            self.stage.rest()
            if answer is None:
                self._pause()
                continue
            self.file.append(answer)
            self.stage.mark(f"study {name} trial {number} answer {answer.answer}")
            if made.feedback:
                self._grade(trial, answer, heading)
        self.file.end()
        self.stage.mark(f"study {name} ends")
        self.shown.show(panel.over(made.trials))

    def _train(self) -> None:
        """Present the stimuli of the answers by name, as often as the participant chooses."""
        made = self.file.session.experiment
        levels = examples(made) if made.correct else {}
        key = next(iter(made.choices))
        while key != NEXT:
            self.shown.show(panel.training(made, key))
            if key in levels:
                self.stage.present(levels[key])
            key = self._wait(lambda: _advice(self.stage))
        self.stage.rest()

    def _practise(self) -> None:
        """Run trials that are not kept, each with feedback; a pause begins it once more."""
        trials = practised(self.file.session.experiment, self.file.session.seed)
        for number, trial in enumerate(trials, 1):
            heading = f"Practice {number} of {len(trials)}"
            answer = None
            while answer is None:
                answer = self._try(trial, number, heading)
                self.stage.rest()
            self._grade(trial, answer, heading)

    def _try(self, trial: Trial, number: int, heading: str) -> Answer | None:
        """Run one trial after a rest; return None if it was interrupted."""
        made = self.file.session.experiment
        self._rest(panel.between(heading), made.rest_s)
        t_start_s = self.clock.monotonic()
        if made.intervals is None:
            self.stage.present(trial.levels)
        elif not self._feel_both(trial, heading):
            return None
        self.shown.show(panel.trial(made, heading))
        while (key := self._wait()) != PAUSE and self.stage.touch.touched_s < LEAST_TOUCH_S:
            self.shown.note("Touch the plate first.")
        if key == PAUSE:
            return None
        touch = self.stage.touch
        return Answer(
            trial=number,
            answer=key,
            t_unix_s=self.clock.time(),
            took_s=self.clock.monotonic() - t_start_s,
            touched_s=touch.touched_s,
            speed_mm_s=touch.speed_mm_s,
            limited_frac=touch.limited.value or 0.0,
            felt_friction=touch.friction.value,
            pressure_frac=touch.pressure.value,
            **touch.errors,
            t_daemon_ns=touch.t_daemon_ns,
        )

    def _feel_both(self, trial: Trial, heading: str) -> bool:
        """Present both intervals, each until it was touched long enough; return whether no one paused."""
        session = self.file.session
        intervals = session.experiment.intervals
        assert intervals is not None
        standard = {**trial.levels, intervals.of: intervals.standard}
        order = (standard, trial.levels) if trial.is_standard_first else (trial.levels, standard)
        what = heading.partition(" of ")[0].lower()  # "trial 3", or "practice 1"
        for which, levels in zip(session.experiment.choices, order, strict=True):
            if which == "second":
                self._rest(panel.between(heading), intervals.pause_s)
            self.stage.present(levels)
            self.stage.mark(f"study {session.participant} {what} interval {which}")
            self.shown.show(panel.interval(heading, which))
            while self.stage.touch.touched_s < intervals.touched_s:
                if self.shown.pressed() == PAUSE:
                    return False
                self.stage.step()
        touch = self.stage.touch
        self.stage.rest()
        self.stage.touch = touch  # of the second interval, for the answer
        return True

    def _rest(self, screen: Screen, rest_s: float) -> None:
        self.stage.rest()
        self.shown.show(screen)
        t_end_s = self.clock.monotonic() + rest_s
        while self.clock.monotonic() < t_end_s:
            self.stage.step()

    def _pause(self) -> None:
        session = self.file.session
        self.shown.show(panel.paused(len(session.answers), session.experiment.trials))
        self._wait()

    def _grade(self, trial: Trial, answer: Answer, heading: str) -> None:
        self.shown.show(panel.graded(heading, is_right=answer.answer == trial.correct))
        self._wait()

    def _wait(self, advice: Callable[[], str] = lambda: "") -> str:
        """Step until a key of the screen is pressed; return it."""
        while (key := self.shown.pressed()) is None:
            self.stage.step()
            if remark := advice():
                self.shown.note(remark)
        return key


def _advice(stage: Stage) -> str:
    """Return advice on the speed: participants learn not to move too fast, as in the paper."""
    speed_mm_s = ADVICE_STEP_MM_S * round(stage.touch.recent_mm_s / ADVICE_STEP_MM_S)
    if speed_mm_s == 0:
        return "  0 mm/s, move your finger"
    return f"{speed_mm_s:3.0f} mm/s, {'too fast: slower' if speed_mm_s > FAST_MM_S else 'a good speed'}"

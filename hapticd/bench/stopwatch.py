"""Where a pass spends its time: the stages of the real path, each function of theirs with a stopwatch around it.

Nothing is rebuilt for the measurement: the functions that the pass calls are replaced by ones that call them and note
the time, and put back afterwards. What the stopwatch itself adds to each noted time is measured and taken off.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ..core import pipeline as pipeline_module
from ..core.board.session import BoardSession
from ..core.plate import parasitic_modes as neighbours_module
from ..core.plate.mode_shapes import ModeShapes
from ..core.prediction.predictor import Predictor
from ..core.solver import instant as moment_module
from ..core.targets.scene import Scene
from ..core.touch.sensor_clock import SensorClock
from ..core.touch.tracking import Tracker
from ..daemon import board_gateway as board_gateway
from ..wire.trackpad import Decoder

# None of these calls another: every moment of a pass belongs to one stage at most.
STAGES: dict[str, Sequence[tuple[Any, str]]] = {
    "decode": ((Decoder, "decode"),),
    "track": ((SensorClock, "update"), (Tracker, "update")),
    "predict": ((Predictor, "update"), (Predictor, "predict"), (Predictor, "velocity")),
    "scene": ((Scene, "amplitude_um"), (Scene, "target_of"), (Scene, "virtual_names")),
    "modes": ((ModeShapes, "at"),),
    "solve": ((moment_module, "solve_fast"), (moment_module, "solve_phased_fast")),
    "neighbours": (
        (neighbours_module.ParasiticModes, "_felt"),
        (neighbours_module, "_zeroed"),
        (neighbours_module, "_all_zeroed"),
        (neighbours_module, "_within"),
    ),
    "gate": ((pipeline_module, "gate"),),
    "session": ((BoardSession, "reference"),),
    "encode": ((board_gateway, "encode"),),
}


class Stopwatch:
    """Times taken by stages since the last `reset`, in ns."""

    def __init__(self) -> None:
        self._own_ns = 0.0
        self._taken_ns: dict[str, int] = {}
        self._calls: dict[str, int] = {}
        self.reset()
        self._own_ns = self._calibrated_ns()

    def reset(self) -> None:
        """Start anew."""
        self._taken_ns = dict.fromkeys(STAGES, 0)
        self._calls = dict.fromkeys(STAGES, 0)

    def taken_us(self) -> dict[str, float]:
        """By stage, without the stopwatch's own share."""
        return {
            stage: max(taken_ns - self._calls[stage] * self._own_ns, 0.0) * 1e-3
            for stage, taken_ns in self._taken_ns.items()
        }

    @contextlib.contextmanager
    def on_every_stage(self) -> Iterator[Stopwatch]:
        """While this lasts, the stages' functions are watched."""
        with contextlib.ExitStack() as undo:
            for stage, places in STAGES.items():
                for owner, name in places:
                    original = vars(owner)[name]
                    undo.callback(setattr, owner, name, original)
                    setattr(owner, name, self._watched(stage, original))
            yield self

    def _watched(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        clock_ns = time.perf_counter_ns

        def watched(*arguments: Any, **named: Any) -> Any:
            t_start_ns = clock_ns()
            result = function(*arguments, **named)
            self._taken_ns[stage] += clock_ns() - t_start_ns
            self._calls[stage] += 1
            return result

        return watched

    def _calibrated_ns(self, calls: int = 2000, repeats: int = 5) -> float:
        """What is noted for a function that does nothing, less what calling it takes."""
        stage = next(iter(STAGES))
        watched = self._watched(stage, _nothing)
        noted_ns, direct_ns = [], []
        for _ in range(repeats):
            self.reset()
            for _ in range(calls):
                watched(1, 2)
            noted_ns.append(self._taken_ns[stage] / calls)
            t_start_ns = time.perf_counter_ns()
            for _ in range(calls):
                _nothing(1, 2)
            direct_ns.append((time.perf_counter_ns() - t_start_ns) / calls)
        self.reset()
        return max(min(noted_ns) - min(direct_ns), 0.0)


def _nothing(*_: object) -> None:
    pass

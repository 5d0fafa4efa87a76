"""The inputs of a lock-step run's machine, to be played to other machines as often as needed.

The machine takes time as an argument, so the same calls make it do the same work: alternatives are timed on exactly
the same reports, board messages and targets, without the simulated plate between them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, NamedTuple

from ..config.sections import Config
from ..core.plate.mode_shapes import ModeShapes
from ..daemon.machine import Machine
from ..sim.fingers.scenarios import Actor
from ..sim.lockstep import T_START_NS, Simulation
from ..sim.settings import Settings

LANDED_NS = T_START_NS + 800_000_000  # fingers are down, the board trusts the host
_CALLS = ("trackpad_link", "board_link", "set_targets", "board_bytes", "timer", "reports")

WaitUntil = Callable[[int], None]


class Call(NamedTuple):
    """One call of the machine, the instant given to it last."""

    name: str
    arguments: tuple[Any, ...]

    @property
    def t_ns(self) -> int:
        """Instant of the call, in virtual time."""
        return int(self.arguments[-1])


class RecordedCalls(NamedTuple):
    """The inputs of a run's machine; `timed` is the call that makes the passes to be timed."""

    calls: tuple[Call, ...]
    timed: str
    modes: ModeShapes

    def is_timed(self, call: Call) -> bool:
        """A pass that counts: made once everything has settled."""
        return call.name == self.timed and call.t_ns >= LANDED_NS


def record(
    actors: tuple[Actor, ...],
    *,
    settings: Settings | None = None,
    seed: int = 1,
    seconds: float,
    timed: str = "reports",
) -> RecordedCalls:
    """Play the actors in virtual time, and keep the machine's inputs."""
    simulation = Simulation(actors, Settings() if settings is None else settings, seed)
    calls: list[Call] = []
    for name in _CALLS:
        setattr(simulation.machine, name, _noted(calls, name, getattr(simulation.machine, name)))
    simulation.run(seconds)
    return RecordedCalls(tuple(calls), timed, simulation.modes)


def new_machine(
    recording: RecordedCalls, config: Config | None = None, publish: Callable[[bytes], None] | None = None
) -> Machine:
    """A machine without inputs so far; what it writes to its board is discarded."""
    return Machine(config or Config(), recording.modes, write_board=lambda _: True, publish=publish)


def play(
    recording: RecordedCalls, machine: Machine, *, wait_until: WaitUntil | None = None, limit: int | None = None
) -> list[float]:
    """Play all inputs, or up to `limit` passes that count. Returns how long each of these took, in us.

    `wait_until` makes each wait for its time of the host's clock, at the pace of the recording.
    """
    taken_us: list[float] = []
    t_begin_ns, t_first_ns = time.monotonic_ns(), 0
    for call in recording.calls:
        if len(taken_us) == limit:
            break
        is_timed = recording.is_timed(call)
        if is_timed and wait_until is not None:
            t_first_ns = t_first_ns or call.t_ns
            wait_until(t_begin_ns + call.t_ns - t_first_ns)
        t_start_ns = time.perf_counter_ns()
        getattr(machine, call.name)(*call.arguments)
        if is_timed:
            taken_us.append((time.perf_counter_ns() - t_start_ns) * 1e-3)
    return taken_us


def sleep_until(t_ns: int) -> None:
    """Sleep until an instant of the host's monotonic clock, as a daemon does that waits for its next report."""
    while (left_ns := t_ns - time.monotonic_ns()) > 0:
        time.sleep(left_ns * 1e-9)


def _noted(calls: list[Call], name: str, method: Callable[..., Any]) -> Callable[..., Any]:
    def noted(*arguments: Any) -> Any:
        calls.append(Call(name, arguments))
        return method(*arguments)

    return noted

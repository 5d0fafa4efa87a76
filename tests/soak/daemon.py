"""Soak of the daemon: hours of virtual time with a fault every two seconds.

Runs of 30 s, each a new daemon and a new board in this one process: two fingers circle, one slippery and one sticky,
while faults of all kinds follow each other at random instants and for random times. Checked are every frame to the
board, the true plate at every control tick, and the detection of and the recovery from each fault.

Not covered: simultaneous faults, wear within one daemon beyond 30 s, the event loop, sockets and the kernel
(`tests/integration` and `tests/io` cover those).
"""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from faulty_line import Line, LineFaults
from faulty_simulation import FaultySimulation, Way
from soak.harness import ALL, Findings, added, judged

from hapticd import board_protocol as protocol
from hapticd.bench.tables import Table
from hapticd.core.board.supervisor import State
from hapticd.sim.fingers.paths import CirclePath, Touch
from hapticd.sim.fingers.scenarios import SLIPPERY_UM, STICKY_UM, Actor
from hapticd.sim.lockstep import T_START_NS
from hapticd.sim.settings import Settings
from hapticd.values import FloatArray
from hapticd.wire.framing import FrameSplitter

RUN_S = 30.0
LIFTED_S, AT_REST_S = 1.2, 0.8  # before the end of a run
FIRST_FAULT_S, RECOVERY_S = 1.5, 0.9  # a board with a wrapped clock is detected after half a second
JUST_BEFORE_S = 0.002  # before the end of a fault: its effect shows, and the next event has not begun
QUIET_UM, DRIVEN_UM = 0.01, 0.3

SetUp = Callable[[FaultySimulation, float, float, np.random.Generator], None]


class Kind(NamedTuple):
    """A kind of fault. `trace` is a counter that grows on detection: by the end of the fault if it `shows_meanwhile`,
    else after it. `quiet_within_ms` is None where the plate need not become quiet."""

    name: str
    lasts_s: tuple[float, float]
    quiet_within_ms: float | None
    set_up: SetUp
    trace: Callable[[FaultySimulation], float]
    shows_meanwhile: bool = True


class Fault(NamedTuple):
    """One fault; instants in seconds of the run."""

    kind: Kind
    t_from_s: float
    t_until_s: float


def run(hours: float = 1.0, *, seed: int = 1) -> Table:
    """Run the soak. Raises HapticdError with all violations if there are any."""
    logging.getLogger("hapticd").setLevel(logging.ERROR)  # two thousand faults would fill the log
    runs = (play(seed * 1_000_000 + number) for number in range(1, 1 + max(1, round(hours * 3600.0 / RUN_S))))
    note = "every fault was detected, and the fingers were driven again after it"
    return judged(runs, name="soak", title="daemon amid faults, in virtual time", notes=(note,))


def play(seed: int) -> Findings:
    """Play one run of two circling fingers; return what references and plate reached, and each fault's effect."""
    circles = CirclePath((-25.0, 5.0), 15.0, 100.0), CirclePath((25.0, -5.0), 15.0, -100.0, start_rad=1.0)
    actors = tuple(
        Actor(((0.0, amplitude_um),), path=Touch(path, 0.1, RUN_S - LIFTED_S))
        for path, amplitude_um in zip(circles, (SLIPPERY_UM, STICKY_UM), strict=True)
    )
    simulation, random = FaultySimulation(actors, Settings(), seed), np.random.default_rng(seed)
    references_um, failures = [0.0], list[str]()
    simulation.ways["board"] = partial(_heard, FrameSplitter(4096), references_um)
    faults = [*drawn(random, 0.0, RUN_S - LIFTED_S)]
    for fault in faults:
        fault.kind.set_up(simulation, fault.t_from_s, fault.t_until_s, random)
        _expect(simulation, fault, failures)
    simulation.run(RUN_S)
    t_s, level_um = simulation.level_um()
    peaks_um = {"reference": max(references_um), "plate": float(level_um.max())}
    limit_um = max(simulation.settings.config.limits.w_limit_um)
    failures += [
        f"a peak of the {what} was {um:g} um, the limit is {limit_um:g}."
        for what, um in peaks_um.items()
        if um > limit_um
    ]
    if level_um[t_s > RUN_S - AT_REST_S].max() > QUIET_UM or simulation.machine.pipeline.fingers:
        failures.append("motion or fingers remain after both fingers were lifted.")
    counts = {"faults_count": float(len(faults)), "frames_count": len(references_um) - 1.0}
    figures = {"virtual_h": RUN_S / 3600.0, **counts, **{f"peak_{what}_um": um for what, um in peaks_um.items()}}
    found = added([Findings({ALL: figures}, failures), *(_checked(fault, t_s, level_um) for fault in faults)])
    return Findings(found.rows, [f"run {seed}: {sentence}" for sentence in found.failures])


def _expect(simulation: FaultySimulation, fault: Fault, failures: list[str]) -> None:
    """Have a sentence among the failures if no counter shows the fault."""
    kind, before = fault.kind, list[float]()
    simulation.at(fault.t_from_s - JUST_BEFORE_S, lambda _: before.append(kind.trace(simulation)))

    def look(_: int) -> None:
        if not kind.trace(simulation) > before[0]:
            failures.append(f"{_which(fault)}: not detected.")

    until_s = fault.t_until_s + (0.0 if kind.shows_meanwhile else RECOVERY_S)
    simulation.at(until_s - JUST_BEFORE_S, look)


def _checked(fault: Fault, t_s: FloatArray, level_um: FloatArray) -> Findings:
    figures, failures = {"faults_count": 1.0}, []
    if fault.kind.quiet_within_ms is not None:
        moving = t_s[(t_s > fault.t_from_s) & (t_s < fault.t_until_s) & (level_um > QUIET_UM)]
        quiet_ms = figures["quiet_after_ms"] = 1e3 * (float(moving[-1]) - fault.t_from_s) if len(moving) else 0.0
        if quiet_ms > fault.kind.quiet_within_ms:
            failures.append(f"{_which(fault)}: the plate still moved after {quiet_ms:.0f} ms.")
    end_s = fault.t_until_s + RECOVERY_S
    if level_um[(t_s > end_s - 0.25) & (t_s <= end_s)].max() < DRIVEN_UM:
        failures.append(f"{_which(fault)}: the fingers are not driven again.")
    return Findings({fault.kind.name: figures}, failures)


def _which(fault: Fault) -> str:
    return f"{fault.kind.name} from {fault.t_from_s:.3f} to {fault.t_until_s:.3f} s"


def drawn(rng: np.random.Generator, t_from_s: float, t_until_s: float) -> Iterator[Fault]:
    """Draw faults one after another; each kind once per round, in random order."""
    t_s = t_from_s + FIRST_FAULT_S
    while True:
        for index in rng.permutation(len(KINDS)):
            kind = KINDS[index]
            start_s = t_s + float(rng.uniform(0.0, 0.05))
            end_s = start_s + float(rng.uniform(*kind.lasts_s))
            t_s = end_s + RECOVERY_S
            if end_s + RECOVERY_S > t_until_s:
                return
            yield Fault(kind, start_s, end_s)


def _heard(splitter: FrameSplitter, references_um: list[float], t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
    """Note the largest amplitude of each reference on its way to the board."""
    references_um += [reference_peak_um(one) for one in splitter.feed(data) if one[0] == protocol.MSG_REFERENCE]
    return [(t_ns, data)]


def reference_peak_um(reference: bytes) -> float:
    """Return the largest modal amplitude of a REFERENCE: seq u16, t_apply u32, knots u8, modes u8, then the knots."""
    knots, modes = reference[7], reference[8]
    knot = struct.Struct(f"<H{2 * modes}f")
    rows = [parts for _, *parts in knot.iter_unpack(reference[9 : 9 + knots * knot.size])]
    return max(abs(complex(d, q)) for parts in rows for d, q in zip(parts[::2], parts[1::2], strict=True))


# --- kinds of faults ---


def _act(begin: str, end: str) -> SetUp:
    """Call two methods of the simulation, at the fault's beginning and end."""

    def set_up(simulation: FaultySimulation, t_from_s: float, t_until_s: float, _: np.random.Generator) -> None:
        simulation.at(t_from_s, getattr(simulation, begin))
        simulation.at(t_until_s, getattr(simulation, end))

    return set_up


def _line(way: Callable[[np.random.Generator], Way], *streams: str) -> SetUp:
    """Pass what these streams carry meanwhile through a way."""

    def set_up(simulation: FaultySimulation, t_from_s: float, t_until_s: float, rng: np.random.Generator) -> None:
        span_ns = range(*(T_START_NS + round(t_s * 1e9) for t_s in (t_from_s, t_until_s)))
        for stream in streams:
            usual = simulation.ways.get(stream, lambda t_ns, data: [(t_ns, data)])
            simulation.ways[stream] = partial(_meanwhile, span_ns, usual, way(rng))

    return set_up


def _meanwhile(span_ns: range, usual: Way, way: Way, t_ns: int, data: bytes) -> list[tuple[int, bytes]]:
    passed = usual(t_ns, data)
    return [out for one in passed for out in way(*one)] if t_ns in span_ns else [*passed]


def _cut(_: np.random.Generator) -> Way:
    return lambda _t_ns, _data: []


def _bad(**faults: float) -> Callable[[np.random.Generator], Way]:
    return lambda rng: Line(LineFaults(**faults), int(rng.integers(1 << 31)))  # type: ignore[arg-type]


def _garbage(rng: np.random.Generator) -> Way:
    """Random bytes between the frames."""
    noise = [rng.bytes(int(rng.integers(1, 200))) + b"\0" for _ in range(8)]
    return lambda t_ns, data: [(t_ns, noise[t_ns % 8]), (t_ns, data)]


def _hostile(simulation: FaultySimulation, t_from_s: float, t_until_s: float, rng: np.random.Generator) -> None:
    """Random bytes as messages of a client."""
    for t_s in rng.uniform(t_from_s, t_until_s - 2 * JUST_BEFORE_S, 20):
        payload = rng.bytes(int(rng.integers(0, 300)))
        simulation.at(float(t_s), lambda t_ns, data=payload: simulation.machine.targets(data, t_ns, "uid 65534"))


def _trips(simulation: FaultySimulation) -> float:
    status = simulation.machine.session.status
    return 0.0 if status is None else float(status.deadman_trips)


def _damaged(simulation: FaultySimulation) -> float:
    """Frames that either end dropped as damaged."""
    status = simulation.machine.session.status
    return sum(simulation.machine.board.dropped.values()) + (0.0 if status is None else status.bad_frames)


def _is_idle(simulation: FaultySimulation) -> float:
    return float(simulation.machine.supervisor.state is State.IDLE)


_SHORT_S, _BOTH = (0.15, 0.6), ("board", "host")
# The link, 5 ms, and the ring-down of modes without an amplifier: 0.3 um in 19 ms.
_LIFTED_MS = 25.0
_DEADMAN_MS = 90.0  # the last frame's link delay, 50 ms, the ramp, and the ring-down from the limit
_BAD_LINES = {
    "a third of all frames damaged": _bad(corrupted=0.3),
    "a third of all frames cut short": _bad(truncated=0.3),
    "garbage on the line": _garbage,
}

KINDS = (
    Kind("trackpad unplugged", _SHORT_S, _LIFTED_MS, _act("pull_trackpad", "plug_trackpad"), _is_idle),
    Kind("trackpad silent", _SHORT_S, 75.0, _line(_cut, "report"), lambda run: not run.machine.pipeline.fingers),
    Kind("board unplugged", _SHORT_S, _DEADMAN_MS, _act("pull_board", "plug_board"), _is_idle),
    Kind(
        "board reset",
        (0.1, 0.1),
        None,
        lambda run, t_from_s, *_: run.at(t_from_s, run.reset_board),
        lambda run: run.machine.session.reboots,
        shows_meanwhile=False,
    ),
    Kind("board deaf", _SHORT_S, _DEADMAN_MS, _line(_cut, "board"), _trips, shows_meanwhile=False),
    Kind("board mute", (1.25, 1.4), 1120.0, _line(_cut, "host"), lambda run: run.machine.session.hello is None),
    Kind("board silent both ways", _SHORT_S, _DEADMAN_MS, _line(_cut, *_BOTH), _trips, shows_meanwhile=False),
    Kind("daemon stopped", _SHORT_S, _DEADMAN_MS, _act("stop_daemon", "resume_daemon"), _trips, shows_meanwhile=False),
    Kind(
        "client stopped",
        (0.7, 0.8),
        540.0,
        _act("stop_client", "resume_client"),
        lambda run: run.machine.scene.next_expiry_ns is None,
    ),
    Kind(
        "a third of all frames lost",
        _SHORT_S,
        None,
        _line(_bad(lost=0.3), *_BOTH),
        lambda run: run.machine.session.ledger.unanswered,
        shows_meanwhile=False,
    ),
    *(Kind(name, _SHORT_S, None, _line(way, *_BOTH), _damaged, False) for name, way in _BAD_LINES.items()),
    Kind("hostile messages", _SHORT_S, None, _hostile, lambda run: run.machine.clients.refused),
)

"""Kinds of faults in a soak: duration, time until the plate must be quiet, and the counter that must detect each."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from faulty_line import Line, LineFaults
from faulty_simulation import FaultySimulation, Way

from hapticd import board_protocol as protocol
from hapticd.core.board.supervisor import State
from hapticd.sim.lockstep import T_START_NS
from hapticd.wire.framing import FrameSplitter

LONGEST_FRAME = 4096
JUST_BEFORE_S = 0.002  # before the end of a fault: its effect shows, and the next event has not begun


class ReferenceMeter:
    """Counts references in the bytes to the board; `peak_um` is their largest modal amplitude."""

    def __init__(self) -> None:
        self.frames = 0
        self.peak_um = 0.0
        self._splitter = FrameSplitter(LONGEST_FRAME)

    def feed(self, data: bytes) -> None:
        """Decode bytes as the board does."""
        for message in self._splitter.feed(data):
            if message[0] == protocol.MSG_REFERENCE:
                self.frames += 1
                self.peak_um = max(self.peak_um, reference_peak_um(message))


class Watch:
    """Injects faults into the links of a simulation, and measures the references to the board.

    `undetected` has a sentence for each fault that no counter showed.
    """

    def __init__(self, simulation: FaultySimulation) -> None:
        self.simulation = simulation
        self.references = ReferenceMeter()
        self.undetected: list[str] = []
        self._windows: dict[str, list[tuple[int, int, Way]]] = {"board": [], "host": [], "report": []}
        simulation.ways |= {"board": self._to_board, "host": self._way("host"), "report": self._way("report")}

    def expect(
        self, kind: Kind, t_from_s: float, t_until_s: float, recovery_s: float, rng: np.random.Generator
    ) -> None:
        """Inject a fault from `t_from_s` to `t_until_s`, and check that it was detected."""
        for stream, windows in self._windows.items():
            self._windows[stream] = [one for one in windows if one[1] > self.simulation.t_ns]
        kind.set_up(self, t_from_s, t_until_s, rng)
        before: list[float] = []
        at = self.simulation.at
        at(t_from_s - JUST_BEFORE_S, lambda _: before.append(kind.trace(self.simulation)))

        def look(_: int) -> None:
            if not kind.trace(self.simulation) > before[0]:
                self.undetected.append(f"{kind.name} from {t_from_s:.3f} to {t_until_s:.3f} s: not detected.")

        at((t_until_s - JUST_BEFORE_S) if kind.shows_meanwhile else t_until_s + recovery_s - JUST_BEFORE_S, look)

    def between(self, stream: str, t_from_s: float, t_until_s: float, way: Way) -> None:
        """Pass data on "board", "host" or "report" through `way` in this time."""
        self._windows[stream].append((_instant_ns(t_from_s), _instant_ns(t_until_s), way))

    def _way(self, stream: str) -> Way:
        def way(t_ns: int, data: bytes) -> Iterable[tuple[int, bytes]]:
            for t_from_ns, t_until_ns, altered in self._windows[stream]:
                if t_from_ns <= t_ns < t_until_ns:
                    return altered(t_ns, data)
            return [(t_ns, data)]

        return way

    def _to_board(self, t_ns: int, data: bytes) -> Iterable[tuple[int, bytes]]:
        self.references.feed(data)
        return self._way("board")(t_ns, data)


SetUp = Callable[[Watch, float, float, np.random.Generator], None]
Trace = Callable[[FaultySimulation], float]


class Kind(NamedTuple):
    """A kind of fault. `trace` is a counter that grows on detection: by the end of the fault if it `shows_meanwhile`,
    else after it. `quiet_within_ms` is None where the plate need not become quiet."""

    name: str
    lasts_s: tuple[float, float]
    quiet_within_ms: float | None
    set_up: SetUp
    trace: Trace
    shows_meanwhile: bool = True


def _instant_ns(t_s: float) -> int:
    return T_START_NS + round(t_s * 1e9)


def reference_peak_um(reference: bytes) -> float:
    """Return the largest modal amplitude of a REFERENCE: seq u16, t_apply u32, knots u8, modes u8, then the knots."""
    knots, modes = reference[7], reference[8]
    knot = struct.Struct(f"<H{2 * modes}f")
    peak_um = 0.0
    for _, *parts in knot.iter_unpack(reference[9 : 9 + knots * knot.size]):
        peak_um = max(peak_um, *(abs(complex(d, q)) for d, q in zip(parts[::2], parts[1::2], strict=True)))
    return peak_um


# --- injection ---


def _act(begin: str, end: str) -> SetUp:
    """Call two methods of the simulation, at the fault's beginning and end."""

    def set_up(watch: Watch, t_from_s: float, t_until_s: float, _: np.random.Generator) -> None:
        watch.simulation.at(t_from_s, getattr(watch.simulation, begin))
        watch.simulation.at(t_until_s, getattr(watch.simulation, end))

    return set_up


def _cut(*streams: str) -> SetUp:
    def set_up(watch: Watch, t_from_s: float, t_until_s: float, _: np.random.Generator) -> None:
        for stream in streams:
            watch.between(stream, t_from_s, t_until_s, lambda _t_ns, _data: [])

    return set_up


def _bad_line(faults: LineFaults) -> SetUp:
    def set_up(watch: Watch, t_from_s: float, t_until_s: float, rng: np.random.Generator) -> None:
        for stream in ("board", "host"):
            watch.between(stream, t_from_s, t_until_s, Line(faults, int(rng.integers(1 << 31))))

    return set_up


def _reset(watch: Watch, t_from_s: float, _until_s: float, _: np.random.Generator) -> None:
    watch.simulation.at(t_from_s, watch.simulation.reset_board)


def _garbage(watch: Watch, t_from_s: float, t_until_s: float, rng: np.random.Generator) -> None:
    """Random bytes from both ends, between the frames."""
    noise = [rng.bytes(int(rng.integers(1, 200))) + b"\0" for _ in range(8)]
    for stream in ("board", "host"):
        watch.between(stream, t_from_s, t_until_s, lambda t_ns, data: [(t_ns, noise[t_ns % 8]), (t_ns, data)])


def _hostile(watch: Watch, t_from_s: float, t_until_s: float, rng: np.random.Generator) -> None:
    """Random bytes as messages of a client."""
    for t_s in rng.uniform(t_from_s, t_until_s - 2 * JUST_BEFORE_S, 20):
        payload = rng.bytes(int(rng.integers(0, 300)))
        watch.simulation.at(float(t_s), lambda t_ns, payload=payload: _send(watch, payload, t_ns))  # type: ignore[misc]


def _send(watch: Watch, payload: bytes, t_ns: int) -> None:
    watch.simulation.machine.targets(payload, t_ns, "uid 65534")


# --- detection ---


def _is_idle(simulation: FaultySimulation) -> float:
    return float(simulation.machine.supervisor.state is State.IDLE)


def _has_no_fingers(simulation: FaultySimulation) -> float:
    return float(not simulation.machine.pipeline.fingers)


def _has_no_targets(simulation: FaultySimulation) -> float:
    return float(simulation.machine.scene.next_expiry_ns is None)


def _has_no_board(simulation: FaultySimulation) -> float:
    return float(simulation.machine.session.hello is None)


def _reboots(simulation: FaultySimulation) -> float:
    return float(simulation.machine.session.reboots)


def _trips(simulation: FaultySimulation) -> float:
    status = simulation.machine.session.status
    return 0.0 if status is None else float(status.deadman_trips)


def _damaged(simulation: FaultySimulation) -> float:
    """Frames that either end dropped as damaged."""
    status = simulation.machine.session.status
    return sum(simulation.machine.board.dropped.values()) + (0.0 if status is None else status.bad_frames)


def _unanswered(simulation: FaultySimulation) -> float:
    return float(simulation.machine.session.ledger.unanswered)


def _refused(simulation: FaultySimulation) -> float:
    return float(simulation.machine.clients.refused)


_SHORT_S = (0.15, 0.6)
# The link, 5 ms, and the ring-down of modes without an amplifier: 0.3 um in 19 ms.
_LIFTED_MS = 25.0
_DEADMAN_MS = 90.0  # the last frame's link delay, 50 ms, the ramp, and the ring-down from the limit

KINDS = (
    Kind("trackpad unplugged", _SHORT_S, _LIFTED_MS, _act("pull_trackpad", "plug_trackpad"), _is_idle),
    Kind("trackpad silent", _SHORT_S, 75.0, _cut("report"), _has_no_fingers),
    Kind("board unplugged", _SHORT_S, _DEADMAN_MS, _act("pull_board", "plug_board"), _is_idle),
    Kind("board reset", (0.1, 0.1), None, _reset, _reboots, shows_meanwhile=False),
    Kind("board deaf", _SHORT_S, _DEADMAN_MS, _cut("board"), _trips, shows_meanwhile=False),
    Kind("board mute", (1.25, 1.4), 1120.0, _cut("host"), _has_no_board),
    Kind("board silent both ways", _SHORT_S, _DEADMAN_MS, _cut("board", "host"), _trips, shows_meanwhile=False),
    Kind("daemon stopped", _SHORT_S, _DEADMAN_MS, _act("stop_daemon", "resume_daemon"), _trips, shows_meanwhile=False),
    Kind("client stopped", (0.7, 0.8), 540.0, _act("stop_client", "resume_client"), _has_no_targets),
    Kind("a third of all frames lost", _SHORT_S, None, _bad_line(LineFaults(lost=0.3)), _unanswered, False),
    Kind("a third of all frames damaged", _SHORT_S, None, _bad_line(LineFaults(corrupted=0.3)), _damaged, False),
    Kind("a third of all frames cut short", _SHORT_S, None, _bad_line(LineFaults(truncated=0.3)), _damaged, False),
    Kind("garbage on the line", _SHORT_S, None, _garbage, _damaged, False),
    Kind("hostile messages", _SHORT_S, None, _hostile, _refused),
)

"""Lock-step simulation: the daemon against the simulated plate in virtual time, deterministic and fast.

Events (a report arrives, bytes reach the board or the host, a timer is due) are in one queue; between them the board's
firmware and the plate run tick by tick. The daemon's part is `machine.Machine`, as in the service.

Idealised: the daemon's run time is constant, clocks do not drift, and the link loses nothing and has the same mean
delay in both directions (half of any difference would shift the board's clock undetected).
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt

from ..board_values import UNCALIBRATED
from ..core.plate.mode_shapes import ModeShapes
from ..daemon.machine import TIMER_NS, Machine
from ..daemon.observer import Observer
from ..errors import SimulationError
from ..values import RawReport
from .active_reference import Passes
from .fingers import fingertip
from .fingers.pressing import Tip
from .fingers.scenarios import SCENARIOS, Actor, Scenario, paths_of, with_motion
from .fingers.scripted import ScriptedClient, virtual_name
from .fingers.sensor import SensorModel
from .paper_scheme import paper_pipeline
from .plate.ground_truth import GroundTruth
from .score import Score, score
from .settings import Measured, Settings, scheme_config
from .world import World
from .world_causes import JitteryLink, played_actors, sensed_paths, sensor_settings

T_START_NS = 1_000_000_000_000  # the virtual host clock starts at an awkward, non-zero instant
BOARD_START_US = 2**32 - 2_000_000  # and the board's wraps after two seconds
TICK_NS = 500_000  # the board's control period
LEAST_S = 0.01  # a shorter run has no sample to score


@dataclass(frozen=True, slots=True)
class Run:
    """A finished run. Arrays over the T control ticks, N fingers (NaN while absent), M modes; units in the names.

    `plate_um` (T,P) are all modes of the plate, `modal_um` the driven ones, `truth_um` the amplitude at each finger's
    true position, from all modes; `finger_predicted_mm` is the position that the active reference assumed. `finger_id`
    (T,N) is the daemon's id of each finger, 0 while it has none; that of a virtual finger is its name.
    """

    scenario: str
    seed: int
    settings: Settings
    t_s: npt.NDArray[np.float64]
    finger_id: npt.NDArray[np.int64]
    finger_true_mm: npt.NDArray[np.float64]
    finger_predicted_mm: npt.NDArray[np.float64]
    target_um: npt.NDArray[np.float64]
    reference_um: npt.NDArray[np.complex128]
    modal_um: npt.NDArray[np.complex128]
    plate_um: npt.NDArray[np.complex128]
    truth_um: npt.NDArray[np.complex128]
    limited: npt.NDArray[np.bool_]
    score: Score
    status: dict[str, Any]
    is_virtual: tuple[bool, ...]  # of each finger
    fingertips: tuple[Tip, ...]  # of each finger
    played: Scenario | None = None


def run(
    scenario: str | Scenario,
    *,
    settings: Settings | Mapping[str, Any] | None = None,
    seed: int = 1,
    seconds: float | None = None,
    observer: Callable[[Machine, ModeShapes], Observer] | None = None,
    measured: Measured | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Run:
    """Play `scenario`, a name or one of the caller's own, for `seconds` of virtual time.

    The same arguments give the same arrays, byte for byte.
    `settings` may be a mapping of some fields of Settings; `observer` makes the machine's observer before the first
    event; `measured` replaces the daemon's mode map and calibrates the board; `progress` is called with the share of
    the run that is done.
    Raises SimulationError, a ValueError, for an unknown scenario or setting and for values out of bounds.
    """
    if isinstance(scenario, str) and scenario not in SCENARIOS:
        raise SimulationError(f"there is no scenario {scenario!r}: choose one of {', '.join(SCENARIOS)}.")
    played = SCENARIOS[scenario] if isinstance(scenario, str) else scenario
    seconds = played.seconds if seconds is None else seconds
    if not LEAST_S <= seconds < math.inf:
        raise SimulationError(f"a run of {seconds} s cannot be played: give a finite number, at least {LEAST_S}.")
    if seed < 0:
        raise SimulationError(f"the seed is {seed}: give 0 or more.")
    valid = Settings.__match_args__
    if not isinstance(settings, Settings) and (unknown := {*(settings or {})} - {*valid}):
        raise SimulationError(f"there is no setting {unknown.pop()!r}: choose from {', '.join(valid)}.")
    chosen = settings if isinstance(settings, Settings) else Settings(**(settings or {}))
    try:
        actors = played.build(seed, chosen.speed_mm_s)
    except ValueError as error:
        raise SimulationError(f"{played.name} cannot be played at {chosen.speed_mm_s:g} mm/s: {error}.") from error
    simulation = Simulation(actors, chosen, seed, measured)
    if observer is not None:
        simulation.machine.parasitic_modes = simulation.world.plate.parasitic_modes(seed)
        simulation.machine.observer = observer(simulation.machine, simulation.modes)
    simulation.run(seconds, progress)
    return replace(simulation.result(played.name), played=played)


class _Rank(IntEnum):
    """The order of events of one instant: those pushed before the run, its reports, its timers, all others."""

    BEFORE, REPORT, TIMER, AFTER = range(4)


class Simulation:
    """A run in progress: the world, the machine, and the events between them."""

    def __init__(
        self, actors: tuple[Actor, ...], settings: Settings, seed: int, measured: Measured | None = None
    ) -> None:
        self.settings = settings
        self.seed = seed
        self.actors = actors = played_actors(with_motion(actors, settings.motion), settings.plate.world)
        self.fingertips = tuple(_fingertip(actor, settings.fingertip) for actor in actors)
        self._config = scheme_config(settings)
        plate = GroundTruth(settings.plate)
        self.world = World(
            paths_of(actors),
            plate,
            w_limit_um=self._config.limits.w_limit_um,
            seed=seed,
            boot_id=seed + 1,
            board_start_us=BOARD_START_US,
            fingertips=self._tips(),
        )
        self.modes = plate.measured_mode_map(seed) if measured is None else measured.modes
        self._calibration = UNCALIBRATED if measured is None else measured.calibration
        self.machine = self._new_machine()
        self._sensor = SensorModel(
            sensor_settings(
                settings.plate.world,
                pad=self.machine.trackpad.pad,
                period_s=settings.report_period_ms * 1e-3,
                latency_s=settings.sensor_latency_ms * 1e-3,
                noise=settings.noise,
                stamp_jitter_ms=settings.stamp_jitter_ms,
            ),
            seed,
        )
        self._link = JitteryLink(settings.link_ms, settings.plate.world.link_jitter_ms, seed)
        self._events: list[tuple[int, _Rank, int, str, bytes]] = []
        self._rank = _Rank.BEFORE
        self._pushed = 0
        self._t_ns = T_START_NS
        curve = self.machine.scene.friction_curve if settings.friction_targets else None
        self._client = ScriptedClient(actors, curve)
        self._passes = Passes(T_START_NS)
        self._finger_ids: list[tuple[float, list[int]]] = []  # of the actors, from each instant on

    def run(self, seconds: float, progress: Callable[[float], None] = lambda _: None) -> None:
        """Run from the start for `seconds`."""
        t_end_ns = T_START_NS + round(seconds * 1e9)
        inputs = self._inputs(seconds)
        due = next(inputs, None)
        self._rank = _Rank.AFTER
        self.machine.trackpad_link(True, "simulated", T_START_NS)
        self.machine.board_link(True, "simulated", T_START_NS)
        while True:
            while due is not None and not (self._events and self._events[0][0] < due[0]):
                t_ns, self._rank, kind, data = due
                self._push(t_ns, kind, data)
                due = next(inputs, None)
            self._rank = _Rank.AFTER
            if not self._events or self._events[0][0] > t_end_ns:
                break
            output = self.world.advance((self._events[0][0] - T_START_NS) * 1e-9)
            if output:
                self._push(self._link.to_host_ns(T_START_NS + round(self.world.t_s * 1e9)), "host", output)
                continue
            t_ns, _, _, kind, data = heapq.heappop(self._events)
            self._t_ns = t_ns
            if kind == "timer":
                progress((t_ns - T_START_NS) * 1e-9 / seconds)
            self._handle(kind, data, t_ns)
        while self.world.advance(seconds):
            pass  # the board's output after the end is not used

    def _tips(self) -> list[Tip]:
        """Return the contacts of the fingers that move along paths."""
        return [tip for actor, tip in zip(self.actors, self.fingertips, strict=True) if actor.path is not None]

    def _inputs(self, seconds: float) -> Iterator[tuple[int, _Rank, str, bytes]]:
        """Yield the run's reports and timers in the order of their instants."""
        paths = sensed_paths(paths_of(self.actors), self.settings.plate.world, self.settings.session)
        reports = (
            (T_START_NS + round(report.t_arrive_s * 1e9), _Rank.REPORT, "report", report.data)
            for report in self._sensor.until(paths, seconds, self._tips())
        )
        instants = range(T_START_NS, T_START_NS + round(seconds * 1e9), TIMER_NS)
        return heapq.merge(reports, ((t_ns, _Rank.TIMER, "timer", b"") for t_ns in instants))

    def _handle(self, kind: str, data: bytes, t_ns: int) -> None:
        if kind == "board":
            self.world.receive(data, (t_ns - T_START_NS) * 1e-9)
        elif kind == "host":
            self.machine.board_bytes(data, t_ns)
        elif kind == "timer":
            self._send_targets(t_ns)
            self.machine.timer(t_ns)
        else:
            self.machine.reports((RawReport(t_ns, data),), t_ns)
            self._send_targets(t_ns)
        tick = self.machine.last_tick
        if tick is not None and tick.t_now_ns == t_ns:
            self._passes.add(tick, self._client.actor_of)
        self._note_finger_ids((t_ns - T_START_NS) * 1e-9)

    def _note_finger_ids(self, t_s: float) -> None:
        finger_ids = [0] * len(self.actors)
        for finger in self.machine.pipeline.fingers:
            finger_ids[self._client.actor_of[finger.finger_id]] = finger.finger_id
        if not self._finger_ids or self._finger_ids[-1][1] != finger_ids:
            self._finger_ids.append((t_s, finger_ids))

    def _send_targets(self, t_ns: int) -> None:
        fingers = [(finger.finger_id, finger.x_mm, finger.y_mm) for finger in self.machine.pipeline.fingers]
        sampled_s = (t_ns - T_START_NS) * 1e-9 - self.settings.sensor_latency_ms * 1e-3
        message = self._client.message((t_ns - T_START_NS) * 1e-9, sampled_s, fingers)
        if message is not None:
            self.machine.set_targets(message, t_ns)

    def _new_machine(self) -> Machine:
        if self.settings.scheme == "paper":
            return Machine(self._config, self.modes, write_board=self._to_board, pipeline=paper_pipeline(self._config))
        return Machine(self._config, self.modes, write_board=self._to_board, calibration=self._calibration)

    def _to_board(self, data: bytes) -> int:
        self._push(self._link.to_board_ns(self._t_ns), "board", data)
        return self._t_ns

    def _push(self, t_ns: int, kind: str, data: bytes) -> None:
        self._pushed += 1
        heapq.heappush(self._events, (t_ns, self._rank, self._pushed, kind, data))

    # --- result ---

    def result(self, scenario: str) -> Run:
        """Return the run so far as arrays, with its score."""
        recording = self.world.recording()
        t_s = recording.t_s
        true_mm = self._true_mm(t_s)
        target_um = np.full(true_mm.shape[:2], np.nan)
        for index, actor in enumerate(self.actors):
            target_um[:, index] = actor.target_um(t_s)
        target_um[~np.isfinite(true_mm[..., 0])] = np.nan
        truth_um = np.einsum("tnp,tp->tn", self.world.plate.shapes(true_mm), recording.plate_um)
        truth_um[~np.isfinite(true_mm[..., 0])] = np.nan
        limited = self._passes.limited(t_s)
        modal_um = recording.plate_um[:, : recording.reference_um.shape[1]]
        return Run(
            scenario=scenario,
            seed=self.seed,
            settings=self.settings,
            t_s=t_s,
            finger_id=self._finger_ids_at(t_s),
            finger_true_mm=true_mm,
            finger_predicted_mm=self._passes.predicted_mm(
                t_s, len(self.actors), self._config.device.plate_delay_ms * 1e-3
            ),
            target_um=target_um,
            reference_um=recording.reference_um,
            modal_um=modal_um,
            plate_um=recording.plate_um,
            truth_um=truth_um,
            limited=limited,
            score=score(
                *(t_s, true_mm, target_um, truth_um, recording.plate_um, self.world.plate.shapes),
                reference_um=recording.reference_um,
                limited=limited,
                limit_frac=float((np.abs(modal_um) / self._config.limits.w_limit_um).max(initial=0.0)),
                curve=self.machine.scene.friction_curve,
                fingertips=self.fingertips,
                gains=self.settings.plate.world.amplitude_gains,
                friction_targets=self.settings.friction_targets,
            ),
            status=self.machine.report_status(self._t_ns),
            is_virtual=tuple(actor.path is None for actor in self.actors),
            fingertips=self.fingertips,
        )

    def _finger_ids_at(self, t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.int64]:
        starts_s, finger_ids = zip(*self._finger_ids, strict=True)
        held: npt.NDArray[np.int64] = np.array(finger_ids)[np.searchsorted(starts_s, t_s, side="right") - 1]
        return held

    def _true_mm(self, t_s: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        true_mm = np.full((len(t_s), len(self.actors), 2), np.nan)
        for index, actor in enumerate(self.actors):
            if actor.path is not None:
                true_mm[:, index] = actor.path.position_mm(t_s)
                continue
            name = virtual_name(index)
            t_ns = T_START_NS + np.round(t_s * 1e9).astype(np.int64)
            true_mm[:, index] = [self.machine.scene.virtual_position_mm(name, int(instant)) for instant in t_ns]
        return true_mm


def _fingertip(actor: Actor, usual: Tip) -> Tip:
    """Return a finger's contact; a virtual one's is what it is taken to be."""
    if actor.path is None:
        return fingertip.USUAL
    return usual if actor.fingertip is None else actor.fingertip

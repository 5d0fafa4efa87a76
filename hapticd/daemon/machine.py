"""The daemon without its sockets: bytes in, bytes out, time as an argument.

Wires the touch path, the board (`board_gateway`) and the clients (`client_gateway`) for both the service (`daemon.py`)
and the lock-step simulation (`sim/lockstep.py`), so that the code tested in virtual time is the code that runs. Every
input passes the observer first. Decisions are made in `core`.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from hapticd_contract.replies import Plate
from hapticd_contract.targets import ClientTargets

from ..board_protocol import BoardState
from ..board_values import UNCALIBRATED, BoardCalibration
from ..config.sections import Config, PlateConfig
from ..core.board.supervisor import DRIVING, Event, State, Supervisor
from ..core.perception import ContactPerception
from ..core.pipeline import Pipeline, PipelineSettings
from ..core.plate.mode_shapes import ModeShapes, ParasiticModes
from ..core.targets.scene import Scene
from ..errors import ConfigError, RequestError
from ..values import LinkTiming, RawReport, Tick
from ..wire.trackpad import DEFAULT_PAD, PADS, Decoder, Pad
from .board_gateway import BoardGateway
from .client_gateway import ClientGateway
from .client_registry import ClientRegistry
from .observer import Observed, Observer
from .perception import Perception
from .settings import effect_knots, friction_curve, max_knots, pipeline_settings, plate_from_pad, uncertainty
from .status import Status

log = logging.getLogger("hapticd")

TIMER_NS = 10_000_000  # period of `timer` while the touch path is active
LOOK_EVERY_NS = 100_000_000  # while idle: whatever starts a touch arrives as a report or a message
STANDBY_EVERY_NS = 400_000_000  # on standby too; the service manager's watchdog allows 1 s
TEND_AFTER_NS = 15_000_000  # without a timer: reports that come more often make its ticks needless
EARLY_NS = 5_000_000  # a timer may come earlier by this and still count
TOUCHED, RELEASED = Event.TOUCHED, Event.RELEASED
PAD_IS_SILENT = "trackpad silent while touched: fingers count as lifted: this computer is too busy, or the pad too slow"
REPORTS_ENDED_NS = 20_000_000  # without reports for so long the timer makes the passes


class Machine:
    """All of hapticd between the trackpad's bytes, the board's bytes and the clients' bytes."""

    def __init__(
        self,
        config: Config,
        modes: ModeShapes,
        *,
        write_board: Callable[[bytes], int | None],
        set_baud: Callable[[int], None] | None = None,
        publish: Callable[[bytes], None] | None = None,
        instance: int = 1,
        calibration: BoardCalibration = UNCALIBRATED,
        parasitic_modes: ParasiticModes | None = None,
        pipeline: PipelineSettings | None = None,
    ) -> None:
        """`write_board` returns when the port took a line, None where it did not; `set_baud` sets its speed,
        which stays as it is without. `publish` takes telemetry. `instance` distinguishes one start from the next for
        clients. `calibration` is sent to the board; `parasitic_modes` are driven by fingers alone. `pipeline` replaces
        the settings that follow from `config`.
        """
        self.config = config
        self.instance = instance
        self.modes = modes
        self.parasitic_modes = parasitic_modes
        self.calibration = calibration
        self._observed = Observed()
        self.supervisor = Supervisor()
        registry = ClientRegistry()
        self.scene = Scene(
            w_limit_um=max(config.limits.w_limit_um),
            friction_curve=friction_curve(config),
            plate_size_mm=(config.plate.size_mm[0], config.plate.size_mm[1]),
        )
        settings = pipeline_settings(config) if pipeline is None else pipeline
        self.pipeline = Pipeline(modes, self.scene, settings)
        self._supervise = partial(_supervise, self.supervisor)
        self._set_baud = set_baud
        self.board = BoardGateway(
            config,
            self.calibration,
            write=write_board,
            set_baud=None if set_baud is None else self._change_baud,
            invalidate_reference=self.pipeline.invalidate_reference,
            observed=self._observed,
            supervise=self._supervise,
        )
        self.session = self.board.session
        self._perception = self._perceived()
        self.find_person: Callable[[str], tuple[PlateConfig, str]] = _no_participants
        # A weak reference: a machine that another replaces is freed at once, without the garbage collector.
        self.clients = ClientGateway(
            self.scene, registry, self.pipeline, self.board, instance, weakref.proxy(self), self._observed
        )
        self.status = Status(
            config,
            modes,
            instance=instance,
            scene=self.scene,
            pipeline=self.pipeline,
            supervisor=self.supervisor,
            board=self.board,
            clients=self.clients,
        )
        self.status.publish = publish
        self._plate_from_pad = plate_from_pad(config)
        self.trackpad = Decoder(PADS.get(config.trackpad.device, DEFAULT_PAD), self._plate_from_pad)
        self.last_tick: Tick | None = None
        self.is_failing = False
        self._t_reports_ns: int | None = None
        self._t_looked_ns = -LOOK_EVERY_NS
        self._t_tended_ns = -TEND_AFTER_NS

    @property
    def observer(self) -> Observer | None:
        """Called with every input, output and decision in order; it may be attached and detached at any time."""
        return self._observed.observer

    @observer.setter
    def observer(self, observer: Observer | None) -> None:
        self._observed.observer = observer

    @property
    def is_idle(self) -> bool:
        """No finger is down and nothing is requested: `timer` may come half as often."""
        return not self.pipeline.fingers and (self.last_tick is None or not self.last_tick.points)

    @property
    def is_unused(self) -> bool:
        """Idle, without targets or a fault, and no tool drives the board: another core may take over unnoticed."""
        board = self.session.status
        is_tool = board is not None and board.state is BoardState.TOOL
        is_latched = self.supervisor.state is State.FAULT  # here alone, where the board that had it is another now
        return self.is_idle and self.scene.next_expiry_ns is None and not (is_tool or is_latched)

    @property
    def timer_period_ns(self) -> int:
        """Time until `timer` is due again; after `reports` the first time not before REPORTS_ENDED_NS."""
        if self.session.is_on_standby:
            return STANDBY_EVERY_NS
        may_wait = self.is_idle and not self.session.awaits_last  # each tick is a keep-alive, and no more is needed
        return 2 * TIMER_NS if may_wait else TIMER_NS

    def _is_active(self) -> bool:
        """Something is touched, requested, failing or watched."""
        return (
            self.status.publish is not None
            or not self.is_idle
            or self.is_failing
            or self.scene.next_expiry_ns is not None
        )

    def _needs_nothing(self, t_now_ns: int) -> bool:
        """Nothing needs attention now: the board holds its zero, or was left quiet."""
        return (
            t_now_ns - self._t_looked_ns < LOOK_EVERY_NS - EARLY_NS
            and not self._is_active()
            and not self.session.must_pulse
            and (self.session.is_on_standby or self.session.follows(t_now_ns))
        )

    def watch(self, publish: Callable[[bytes], None] | None, t_now_ns: int) -> None:
        """Send telemetry to `publish` from now on; with None there is no subscriber, and none is built."""
        if (publish is None) != (self.status.publish is None):
            self._observed.put("watched", t_now_ns, publish is not None)
        self.status.publish = publish

    def _perceived(self) -> Perception:
        curve, expected = self.scene.friction_curve, uncertainty(self.config)
        radius_mm = self.pipeline.contact_radius_mm
        return Perception(
            self.pipeline,
            self.session,
            ContactPerception(curve, self.config.solver.contact_radius_mm, expected),
            ContactPerception(curve, radius_mm, expected),
            has_contacts=radius_mm > 0.0,
        )

    # --- the touch ---

    def reports(self, batch: Sequence[RawReport], t_now_ns: int) -> int | None:
        """Take all reports that were waiting, newest last: each is tracked, one pass is made.

        Returns when the port took the pass's reference, None if it sent none.
        """
        if self._observed.observer is not None:
            self._observed.put("reports", t_now_ns, batch)
        self._t_reports_ns = t_now_ns
        t_written_ns = self._pass(t_now_ns, batch)
        if t_now_ns - self._t_tended_ns >= TEND_AFTER_NS:
            self._tend(t_now_ns)
        return t_written_ns

    def _pass(self, t_now_ns: int, batch: Sequence[RawReport] = ()) -> int | None:
        """Track, predict, solve and send. Any failure in it ends in silence, not in a reference that stands."""
        if self.session.is_on_standby and len(batch) > 0:
            self.board.wake(t_now_ns)
        timing = self.link_timing(t_now_ns)
        try:
            tick = self._decide(batch, t_now_ns, timing)
            self.is_failing = False
        except Exception:
            if not self.is_failing:  # once, not ninety times a second
                log.exception("a pass failed: the plate is quiet until one succeeds")
            self.is_failing = True
            self.status.failed_passes += 1
            tick = self.pipeline.silence(t_now_ns, timing.ahead_ns)
        self.last_tick = tick
        t_written_ns = self.board.follow(tick, t_now_ns)
        is_touched = len(tick.points) > 0
        if not self.is_failing and is_touched is not (self.supervisor.state is State.ACTIVE):
            self._supervise(TOUCHED if is_touched else RELEASED, "", t_now_ns)
        events = self.pipeline.events.take() if self.pipeline.events.waiting else ()
        observer = self._observed.observer
        is_perceived = self.status.publish is not None or observer is not None
        judged, perceived = self._perception.judge(tick) if is_perceived else (tick, {})
        if observer is not None:
            observer("pass", t_now_ns, judged, self.supervisor.state.name, self.pipeline.fingers, perceived)
            for event in events:
                observer("event", t_now_ns, event)
        if self.status.publish is not None:  # else nothing is built
            self.status.publish(self.status.telemetry(judged, perceived, events))
        self.clients.markers.clear()
        return t_written_ns

    def _decide(self, batch: Sequence[RawReport], t_now_ns: int, timing: LinkTiming) -> Tick:
        decode = self.trackpad.decode
        frames = [(one, t_read_ns) for t_read_ns, data in batch for one in decode(data, t_read_ns)]
        return self.pipeline.drive(t_now_ns, timing, frames)

    def link_timing(self, t_now_ns: int) -> LinkTiming:
        """Return the board's timing for a pass; its computing is in `ahead_ns`. A board on standby is given the last
        reference when it wakes."""
        session = self.session
        is_followed = session.is_on_standby or session.holds(t_now_ns)
        holdable_frac = () if session.status is None else session.status.holdable_frac
        return LinkTiming(session.latency.link_ns, self.supervisor.state in DRIVING, is_followed, holdable_frac)

    def timer(self, t_now_ns: int) -> None:
        """Due every TIMER_NS: expire targets, lift the fingers of a silent pad, keep the board alive; without reports,
        make the pass that moves virtual fingers. Idle, all is due every LOOK_EVERY_NS, keep-alives in between.
        """
        if self._observed.observer is not None:  # an idle tick takes 1.6 us, a call without effect 0.07
            self._observed.put("timer", t_now_ns)
        if self._needs_nothing(t_now_ns):
            if not self.session.is_on_standby:
                self.board.keep_alive(t_now_ns)
            return
        self._tend(t_now_ns)
        if self.session.is_on_standby and not self.clients.markers:
            return
        if self._t_reports_ns is None or t_now_ns - self._t_reports_ns >= REPORTS_ENDED_NS:
            self._pass(t_now_ns)

    def _tend(self, t_now_ns: int) -> None:
        """Everything that is due by time alone."""
        self._t_looked_ns = self._t_tended_ns = t_now_ns
        self.board.standby_or_wake(self._is_active(), t_now_ns)
        released = self.scene.expire(t_now_ns)
        if released:
            self.pipeline.release(released)
        if self.pipeline.sensor_is_silent(t_now_ns):
            log.warning(PAD_IS_SILENT)
            self.pipeline.sensor_lost()
        self.board.tend(t_now_ns)

    def trackpad_link(self, up: bool, reason: str, t_now_ns: int, *, pad: Pad | None = None) -> None:
        """Take note that the trackpad was connected or lost; `pad` is what it turned out to be."""
        self._observed.put("trackpad_link", t_now_ns, up, reason, pad)
        log.log(logging.INFO if up else logging.WARNING, "trackpad: %s", reason)
        if pad is not None and pad != self.trackpad.pad:
            self.trackpad = Decoder(pad, self._plate_from_pad)
        self.trackpad.reset()
        self.pipeline.sensor_lost()
        self._supervise(Event.SENSOR_UP if up else Event.SENSOR_DOWN, reason, t_now_ns)
        self._pass(t_now_ns)

    def budget(self, frac: float, t_now_ns: int) -> None:
        """Let passes use this share of their time budget: less where they took too long on this machine."""
        self._observed.put("budget", t_now_ns, frac)
        self.pipeline.budget_frac = frac

    def stop(self, t_now_ns: int) -> None:
        """Leave a quiet plate: the last reference is zero."""
        self._observed.put("stop", t_now_ns)
        self._supervise(Event.STOP, "stopping", t_now_ns)
        self.board.follow(self.pipeline.silence(t_now_ns, 0), t_now_ns)

    # --- the board ---

    def board_link(self, up: bool, reason: str, t_now_ns: int) -> None:
        """Take note that the serial port was opened or lost."""
        self._observed.put("board_link", t_now_ns, up, reason)
        self.board.link(up, reason, t_now_ns)

    def self_test(self, outcome: str, text: str, t_now_ns: int) -> None:
        """Take the state or result of the board's self-test (`daemon.self_test`): the next handshake heeds it."""
        self._observed.put("self_test", t_now_ns, outcome, text)
        self.board.take_self_test(outcome, text)

    def board_bytes(self, data: bytes, t_now_ns: int) -> None:
        """Take bytes from the board."""
        if self._observed.observer is not None:
            self._observed.put("board_bytes", t_now_ns, data)
        self.board.receive(data, t_now_ns)

    def disconnect(self, t_now_ns: int) -> bool:
        """End the session with a board that is quiet; False where there is none."""
        self._observed.put("disconnect", t_now_ns)
        return self.board.disconnect(t_now_ns)

    # --- the clients ---

    def targets(self, payload: bytes, t_now_ns: int, user: str = "", waited_ns: int = 0) -> None:
        """Take a message of the targets socket, sent by `user`, that arrived `waited_ns` ago."""
        self._observed.put("targets", t_now_ns, payload, user, waited_ns)
        self.clients.targets(payload, t_now_ns, user, waited_ns)

    def set_targets(self, message: ClientTargets, t_now_ns: int) -> tuple[str, ...]:
        """Apply a client's targets given as values; returns one error message per refused finger."""
        self._observed.put("targets", t_now_ns, message, "", 0)
        return self.clients.set_targets(message, t_now_ns)

    def request(self, payload: bytes, t_now_ns: int, user: str = "", waited_ns: int = 0) -> bytes:
        """Answer a message of the control socket, sent by `user`, that arrived `waited_ns` ago."""
        self._observed.put("request", t_now_ns, payload, user, waited_ns)
        return self.clients.request(payload, t_now_ns, user, waited_ns)

    def wake_if_on_standby(self, t_now_ns: int) -> None:
        """Arm a board on standby: targets are in force."""
        if self.session.is_on_standby:
            self.board.standby_or_wake(self._is_active(), t_now_ns)

    def _change_baud(self, baud: int) -> None:
        """Set the line's speed, and let frames have as many knots as it then carries."""
        assert self._set_baud is not None
        self._set_baud(baud)
        self.pipeline.set_knot_limits(max_knots(self.config, baud), effect_knots(self.config, baud))

    def clear_fault(self, t_now_ns: int) -> None:
        """Clear the board's fault, if it has one. Raises RequestError."""
        if self.supervisor.state is State.FAULT:
            self.board.clear_fault(t_now_ns)

    def report_status(self, t_now_ns: int) -> dict[str, object]:
        """Return the answer to `status`."""
        return self.status.collect(self.trackpad, self._t_reports_ns, t_now_ns)

    def switch_person(self, name: str, t_now_ns: int) -> Mapping[str, object]:
        """Let a participant touch the plate; return the answer to `person`. Raises RequestError, and then nothing has
        changed."""
        try:
            plate, note = self.find_person(name)
        except ConfigError as error:
            raise RequestError(str(error)) from None
        self.person(name, plate.friction_curve, plate.friction_floor_frac, plate.friction_speed_mm_s, t_now_ns)
        return {"note": note}

    def person(
        self, name: str, friction_curve_um: Sequence[float], floor_frac: float, speed_mm_s: float, t_now_ns: int
    ) -> None:
        """Take the friction curve of a participant, as in `PlateConfig`."""
        self._observed.put("person", t_now_ns, name, friction_curve_um, floor_frac, speed_mm_s)
        plate = replace(
            self.config.plate,
            friction_curve=tuple(friction_curve_um),
            friction_floor_frac=floor_frac,
            friction_speed_mm_s=speed_mm_s,
        )
        self.config = replace(self.config, plate=plate)
        self.pipeline.set_friction_curve(friction_curve(self.config))
        self._perception = self._perceived()
        self.status.person = name

    def describe_plate(self) -> Plate:
        """Return the answer to `plate`."""
        return self.status.plate()


def _no_participants(_: str) -> tuple[PlateConfig, str]:
    raise ConfigError("This plate has no participants.")


def _supervise(supervisor: Supervisor, event: Event, reason: str, t_now_ns: int) -> None:
    before = supervisor.state
    after = supervisor.handle(event, reason, t_now_ns)
    if after is before:
        return
    if after is State.FAULT:
        log.error("board fault: %s. Output disabled; a client must clear the fault", reason)
    elif event is Event.CLEARED:
        log.info("board fault cleared: %s", reason)
    else:  # each touch changes the state; what matters of the other changes was logged at its cause
        log.debug("%s -> %s%s", before.name, after.name, f": {reason}" if reason else "")

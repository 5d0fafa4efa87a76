"""The daemon without its sockets: bytes in, bytes out, time as an argument.

It wires touch, board (`board_gateway`) and clients (`client_gateway`) for both the service (`daemon.py`) and the
lock-step simulation (`sim/lockstep.py`), so that what is tested in virtual time is what runs. Whatever it hears goes by
the tap first. It decides nothing that `core` could decide.
"""

from __future__ import annotations

import logging
import weakref
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from ..board_values import BoardState, ModeCalibration
from ..config.sections import Config
from ..core.board.ledger import LoopTiming
from ..core.board.supervisor import Event, State, Supervisor
from ..core.pipeline import Pipeline, PipelineSettings
from ..core.plate.mode_shapes import ModeShapes
from ..core.plate.parasitic_modes import ParasiticModes
from ..core.targets.scene import Scene
from ..values import ClientTargets, RawReport, Tick
from ..wire import trackpad as trackpad_wire
from . import status
from .board_gateway import BoardGateway
from .client_gateway import ClientGateway
from .observer import Observer
from .settings import friction_curve, pipeline_settings, plate_from_pad

log = logging.getLogger("hapticd")

TIMER_NS = 10_000_000  # how often `timer` wants to be called
LOOK_EVERY_NS = 100_000_000  # while nothing is going on; what begins something comes as a report or a message
REST_EVERY_NS = 400_000_000  # the same where the board rests as well; the service manager waits for 1 s
TEND_AFTER_NS = 15_000_000  # without a timer: reports that come more often make its ticks needless
EARLY_NS = 5_000_000  # by which a timer may come before its time and count all the same
REPORTS_ENDED_NS = 20_000_000  # after so long without reports the timer makes the passes


class Machine:
    """All of hapticd between the trackpad's bytes, the board's bytes and the clients' bytes."""

    def __init__(
        self,
        config: Config,
        modes: ModeShapes,
        *,
        write_board: Callable[[bytes], bool],
        publish: Callable[[bytes], None] | None = None,
        instance: int = 1,
        calibration: Sequence[ModeCalibration] = (),
        parasitic_modes: ParasiticModes | None = None,
        pipeline: PipelineSettings | None = None,
    ) -> None:
        """`publish` takes telemetry, where somebody listens; `instance` tells clients one start from the next;
        `calibration` is what the board shall know of its modes, `parasitic_modes` the modes that only fingers drive."""
        self.config = config
        self.instance = instance
        self.modes = modes
        self.supervisor = Supervisor()
        self.scene = Scene(
            w_limit_um=max(config.limits.w_limit_um),
            friction_curve=friction_curve(config),
            plate_size_mm=(config.plate.size_mm[0], config.plate.size_mm[1]),
        )
        self.parasitic_modes = parasitic_modes
        settings = pipeline_settings(config) if pipeline is None else pipeline
        self.pipeline = Pipeline(modes, self.scene, settings, parasitic_modes=parasitic_modes)
        self._supervise = partial(_supervise, self.supervisor)
        self.board = BoardGateway(
            config, calibration, write=write_board, on_unsent=self.pipeline.forget_standing, supervise=self._supervise
        )
        self.session = self.board.session
        # Neither part holds the machine: one that another replaces is gone at once, unseen by the garbage collector.
        self.clients = ClientGateway(self.scene, instance, weakref.proxy(self))
        model = "mt2-usb" if config.trackpad.model == "auto" else config.trackpad.model
        self.trackpad = trackpad_wire.Decoder(model, plate_from_pad(config))
        self.last_tick: Tick | None = None
        self.published = self.skipped_no_subscriber = 0
        self.lost_messages: Callable[[], Mapping[str, int]] = dict  # what never came here, as the sockets counted it
        self.recording: Callable[[], Mapping[str, object]] = dict  # who writes down what the observer is told
        self.publish = publish
        self.calibration = tuple(calibration)
        self.is_failing = False
        self.loop = LoopTiming()
        self.real_time: Mapping[str, object] = {}
        self.t_reports_ns: int | None = None
        self._observer: Observer | None = None
        self._t_looked_ns = -LOOK_EVERY_NS
        self._t_tended_ns = -TEND_AFTER_NS

    @property
    def observer(self) -> Observer | None:
        """Told whatever the machine hears, writes and finds, in its order; it may come late and leave early."""
        return self._observer

    @observer.setter
    def observer(self, observer: Observer | None) -> None:
        self._observer = self.board.observer = self.clients.observer = observer

    @property
    def is_idle(self) -> bool:
        """No finger is down and nobody wants anything: `timer` may come half as often."""
        return not self.pipeline.fingers and (self.last_tick is None or not self.last_tick.points)

    @property
    def is_unused(self) -> bool:
        """Idle, no wish stands and nobody tries the board at the bench: another core may take over unnoticed."""
        board = self.session.status
        is_tool = board is not None and board.state is BoardState.TOOL
        return self.is_idle and self.scene.next_expiry_ns is None and not is_tool

    @property
    def timer_period_ns(self) -> int:
        """How often `timer` need come, as things are; after `reports` the first time not before REPORTS_ENDED_NS."""
        if self.session.is_resting:
            return REST_EVERY_NS
        return 2 * TIMER_NS if self.is_idle else TIMER_NS  # idle, each tick is a keep-alive, and no more is needed

    def _is_wanted(self) -> bool:
        """Something goes on, or somebody looks on."""
        return self.publish is not None or not self.is_idle or self.is_failing or self.scene.next_expiry_ns is not None

    def _rests(self, t_now_ns: int) -> bool:
        """Nothing need be looked at now: the board keeps to the zero that it was told, or was left quiet."""
        return (
            t_now_ns - self._t_looked_ns < LOOK_EVERY_NS - EARLY_NS
            and not self._is_wanted()
            and (self.session.is_resting or self.session.follows(t_now_ns))
        )

    def watch(self, publish: Callable[[bytes], None] | None, t_now_ns: int) -> None:
        """Telemetry goes to `publish` from now on; with None nobody looks on, and none is built."""
        if self._observer is not None and (publish is None) != (self.publish is None):
            self._observer("watched", t_now_ns, publish is not None)
        self.publish = publish

    # --- the touch ---

    def reports(self, batch: Sequence[RawReport], t_now_ns: int) -> None:
        """All reports that were waiting, newest last: every one is tracked, one pass is made."""
        if self._observer is not None:
            self._observer("reports", t_now_ns, batch)
        self.t_reports_ns = t_now_ns
        self._pass(t_now_ns, batch)
        if t_now_ns - self._t_tended_ns >= TEND_AFTER_NS:
            self._tend(t_now_ns)

    def _pass(self, t_now_ns: int, batch: Sequence[RawReport] = ()) -> None:
        """Track, predict, solve and send. Whatever fails in it ends in silence, not in a reference that stands."""
        if self.session.is_resting and len(batch) > 0:
            self.board.wake(t_now_ns)
        ahead_ns = self.ahead_ns
        try:
            tick = self._decide(batch, t_now_ns, ahead_ns)
            self.is_failing = False
        except Exception:
            if not self.is_failing:  # once, not ninety times a second
                log.exception("a pass failed: the plate is quiet until one succeeds")
            self.is_failing = True
            tick = self.pipeline.rest(t_now_ns, ahead_ns)
        self.last_tick = tick
        self.board.follow(tick, t_now_ns)
        if self._observer is not None:
            self._observer("pass", t_now_ns, tick, self.supervisor.state.name, self.pipeline.fingers)
        if self.publish is None:
            self.skipped_no_subscriber += 1
        else:
            self.published += 1
            self.publish(status.telemetry(self, tick))
        self.clients.markers.clear()

    def _decide(self, batch: Sequence[RawReport], t_now_ns: int, ahead_ns: int) -> Tick:
        for report in batch:
            for frame in self.trackpad.decode(report.data, report.t_host_ns):
                self.pipeline.touch(frame, report.t_host_ns)
        keys = self.pipeline.wanted(t_now_ns)
        self._supervise(Event.TOUCHED if keys else Event.RELEASED, "", t_now_ns)
        if not self.may_drive:
            return self.pipeline.rest(t_now_ns, ahead_ns)
        if not self.keeps_reference(t_now_ns):
            self.pipeline.forget_standing()  # what the board did not take is said again, until it does
        return self.pipeline.drive(t_now_ns, ahead_ns, keys)

    # What a pass takes from the board. `hapticd replay --set` puts recorded values in its place.

    @property
    def ahead_ns(self) -> int:
        """From a pass's start to its effect, so computing is in it."""
        return self.session.latency.link_ns

    @property
    def may_drive(self) -> bool:
        """The board may be given a reference other than zero."""
        return self.supervisor.may_drive

    def keeps_reference(self, t_now_ns: int) -> bool:
        """The board has the last reference, or will be given it when it wakes."""
        return self.session.follows(t_now_ns) or self.session.is_resting

    def timer(self, t_now_ns: int) -> None:
        """Due every TIMER_NS: targets expire, a silent pad lifts its fingers, the board is kept alive; and where no
        report makes a pass, virtual fingers walk on. At rest all that is looked at every LOOK_EVERY_NS, and in between
        the board hears that its reference stands."""
        if self._observer is not None:
            self._observer("timer", t_now_ns)
        if self._rests(t_now_ns):
            if not self.session.is_resting:
                self.board.keep_alive(t_now_ns)
            return
        self._tend(t_now_ns)
        if self.session.is_resting and not self.clients.markers:
            return
        if self.t_reports_ns is None or t_now_ns - self.t_reports_ns >= REPORTS_ENDED_NS:
            self._pass(t_now_ns)

    def _tend(self, t_now_ns: int) -> None:
        """All that time alone brings about."""
        self._t_looked_ns = self._t_tended_ns = t_now_ns
        self.board.rest_or_wake(self._is_wanted(), t_now_ns)
        released = self.scene.expire(t_now_ns)
        if released:
            self.pipeline.release(released)
        if self.pipeline.sensor_is_silent(t_now_ns):
            log.warning("trackpad silent with %d fingers down: they count as lifted", len(self.pipeline.fingers))
            self.pipeline.sensor_lost()
        self.board.tend(t_now_ns)

    def trackpad_link(self, up: bool, reason: str, t_now_ns: int, *, model: str | None = None) -> None:
        """The trackpad came or went; `model` says which one it is, where that was not configured."""
        if self._observer is not None:
            self._observer("trackpad_link", t_now_ns, up, reason, model)
        log.log(logging.INFO if up else logging.WARNING, "trackpad: %s", reason)
        if model is not None and model != self.trackpad.model:
            self.trackpad = trackpad_wire.Decoder(model, plate_from_pad(self.config))
        self.trackpad.reset()
        self.pipeline.sensor_lost()
        self._supervise(Event.SENSOR_UP if up else Event.SENSOR_DOWN, reason, t_now_ns)
        self._pass(t_now_ns)

    def stop(self, t_now_ns: int) -> None:
        """Leave a quiet plate: the last thing that is said."""
        if self._observer is not None:
            self._observer("stop", t_now_ns)
        self._supervise(Event.STOP, "stopping", t_now_ns)
        self.board.follow(self.pipeline.rest(t_now_ns, 0), t_now_ns)

    # --- the board ---

    def board_link(self, up: bool, reason: str, t_now_ns: int) -> None:
        """The serial port came or went."""
        if self._observer is not None:
            self._observer("board_link", t_now_ns, up, reason)
        self.board.link(up, reason, t_now_ns)

    def board_bytes(self, data: bytes, t_now_ns: int) -> None:
        """What the board said."""
        if self._observer is not None:
            self._observer("board_bytes", t_now_ns, data)
        self.board.receive(data, t_now_ns)

    def disconnect(self, t_now_ns: int) -> bool:
        """End the session with a board that has come to rest; False where there is none."""
        if self._observer is not None:
            self._observer("disconnect", t_now_ns)
        return self.board.disconnect(t_now_ns)

    # --- the clients ---

    def targets(self, payload: bytes, t_now_ns: int, user: str = "") -> None:
        """A message of the targets socket, sent by `user`."""
        if self._observer is not None:
            self._observer("targets", t_now_ns, payload, user)
        self.clients.targets(payload, t_now_ns, user)

    def want(self, message: ClientTargets, t_now_ns: int) -> tuple[str, ...]:
        """The targets of a client that speaks in values; sentences for what it may not have."""
        if self._observer is not None:
            self._observer("targets", t_now_ns, message, "")
        return self.clients.want(message, t_now_ns)

    def request(self, payload: bytes, t_now_ns: int, user: str = "") -> bytes:
        """Answer a message of the control socket, sent by `user`."""
        if self._observer is not None:
            self._observer("request", t_now_ns, payload, user)
        return self.clients.request(payload, t_now_ns, user)

    def wake_if_resting(self, t_now_ns: int) -> None:
        """What a client wants is in force; a board that rests is armed for it now."""
        if self.session.is_resting:
            self.board.rest_or_wake(self._is_wanted(), t_now_ns)

    def clear_fault(self, t_now_ns: int) -> None:
        """Have the board leave its fault, if it has one. Raises RequestError."""
        if self.supervisor.state is State.FAULT:
            self.board.clear_fault(t_now_ns)

    def report_status(self, t_now_ns: int) -> dict[str, object]:
        """What `hapticd`'s clients see of its inner life."""
        return status.collect(self, t_now_ns)

    def describe_plate(self) -> dict[str, object]:
        """What a picture of the plate needs."""
        return status.plate(self)


def _supervise(supervisor: Supervisor, event: Event, reason: str, t_now_ns: int) -> None:
    before = supervisor.state
    after = supervisor.handle(event, reason, t_now_ns)
    if after is before:
        return
    if after is State.FAULT:
        log.error("board fault: %s; the plate stays quiet until a client clears it", reason)
    elif event is Event.CLEARED:
        log.info("board fault left: %s", reason)
    else:  # each touch is one, and what matters of the others was said where it happened
        log.debug("%s -> %s%s", before.name, after.name, f": {reason}" if reason else "")

"""The daemon without its sockets: bytes in, bytes out, time as an argument.

It wires decoders, core and encoders for both the service (`daemon.py`) and the lock-step simulation
(`sim/lockstep.py`), so that what is tested in virtual time is what runs. It decides nothing that `core` could decide.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from . import __version__, status
from .board_values import (
    BoardCommand,
    BoardHello,
    BoardMessage,
    BoardState,
    BoardStatus,
    BoardTime,
    ClearFault,
    HelloRequest,
    ModeCalibration,
)
from .config_sections import Config
from .core.clientele import Clientele
from .core.ledger import LoopTiming
from .core.modes import ModeShapes
from .core.neighbours import Neighbours
from .core.pipeline import Pipeline
from .core.scene import Scene
from .core.session import BoardSession
from .core.supervisor import Event, State, Supervisor
from .errors import DeviceError, RequestError
from .tool_values import BoardVerdict, ToolMessage, Verdict
from .values import ClientTargets, RawReport, Tick
from .wire import client as client_wire
from .wire import device as device_wire
from .wire import protocol
from .wire import trackpad as trackpad_wire
from .wire.commands import encode
from .wiring import friction_curve, pipeline_settings, plate_from_pad

log = logging.getLogger("hapticd")

TIMER_NS = 10_000_000  # how often `timer` wants to be called
LOOK_EVERY_NS = 100_000_000  # while nothing is going on; what begins something comes as a report or a message
REST_EVERY_NS = 400_000_000  # the same where the board rests as well; the service manager waits for 1 s
REST_AFTER_NS = 2_000_000_000  # of that: then the board is left quiet, and kept alive no more
TEND_AFTER_NS = 15_000_000  # without a timer: reports that come more often make its ticks needless
EARLY_NS = 5_000_000  # by which a timer may come before its time and count all the same
REPORTS_ENDED_NS = 20_000_000  # after so long without reports the timer makes the passes
CLEAR_WITHIN_NS = 500_000_000  # the board agrees at once, or the fault persists
MAX_MARKERS = 64  # told in one state; a client that sends more between two passes has lost count itself
FRESH_START = b"\0"  # ends what a frame cut short left on the line, which would else take this one with it
# A pass on a slow machine, until frames were acknowledged: their delay, from the pass's beginning on, contains it.
START_COMPUTE_NS = 400_000
# The board's look-ahead laws read the reference 0.55 ms before they play it. Frames do not come earlier for that: to
# predict so much farther ahead leaks 0.7 % more (strokes, seeds 1 to 5) than to miss the first tick of each.


Tap = Callable[..., None]  # (kind, t_ns, *values): what a machine hears, writes and finds; `recording.records` has all


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
        neighbours: Neighbours | None = None,
    ) -> None:
        """`publish` takes telemetry, where somebody listens; `instance` tells clients one start from the next;
        `calibration` is what the board shall know of its modes, `neighbours` the modes that only fingers drive."""
        self.config = config
        self.instance = instance
        self.modes = modes
        self.supervisor = Supervisor()
        self.scene = Scene(
            w_limit_um=max(config.limits.w_limit_um),
            friction_curve=friction_curve(config),
            plate_size_mm=(config.plate.size_mm[0], config.plate.size_mm[1]),
        )
        self.clientele = Clientele()
        self.neighbours = neighbours
        self.pipeline = Pipeline(modes, self.scene, pipeline_settings(config), neighbours=neighbours)
        self.session = BoardSession(
            link_start_ns=round(config.device.link_ms * 1e6) + START_COMPUTE_NS,
            controller=config.device.controller,
            calibration=calibration,
        )
        model = "mt2-usb" if config.trackpad.model == "auto" else config.trackpad.model
        self.trackpad = trackpad_wire.Decoder(model, plate_from_pad(config))
        self.board = device_wire.Decoder()
        self.last_tick: Tick | None = None
        self.published = 0
        self.skipped_no_subscriber = 0
        self.messages_refused = 0
        self.messages_overtaken = 0
        self.lost_messages: Callable[[], Mapping[str, int]] = dict  # what never came here, as the sockets counted it
        self.recording: Callable[[], Mapping[str, object]] = dict  # who writes down what the tap is told
        self.last_refusal = ""
        self.publish = publish
        self.tap: Tap | None = None
        self.markers: list[client_wire.Marker] = []  # that telemetry has not told yet
        self.calibration = tuple(calibration)
        self._write_board = write_board
        self.unsent = 0
        self.refused_board = ""
        self.is_failing = False
        self.loop = LoopTiming()
        self.real_time: Mapping[str, object] = {}
        self.t_reports_ns: int | None = None
        self._t_clear_until_ns: int | None = None
        self._t_looked_ns = -LOOK_EVERY_NS
        self._t_tended_ns = -TEND_AFTER_NS
        self._t_wanted_ns = 0

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

    def _is_unwanted(self) -> bool:
        """Nothing goes on, and nobody looks on."""
        return self.publish is None and self.is_idle and not self.is_failing and self.scene.next_expiry_ns is None

    def _rests(self, t_now_ns: int) -> bool:
        """Nothing need be looked at now: the board keeps to the zero that it was told, or was left quiet."""
        return (
            t_now_ns - self._t_looked_ns < LOOK_EVERY_NS - EARLY_NS
            and self._is_unwanted()
            and (self.session.is_resting or self.session.follows(t_now_ns))
        )

    def watch(self, publish: Callable[[bytes], None] | None, t_now_ns: int) -> None:
        """Telemetry goes to `publish` from now on; with None nobody looks on, and none is built."""
        if self.tap is not None and (publish is None) != (self.publish is None):
            self.tap("watched", t_now_ns, publish is not None)
        self.publish = publish

    # --- the touch ---

    def reports(self, batch: Sequence[RawReport], t_now_ns: int) -> None:
        """All reports that were waiting, newest last: every one is tracked, one pass is made."""
        if self.tap is not None:
            self.tap("reports", t_now_ns, batch)
        self.t_reports_ns = t_now_ns
        self._pass(t_now_ns, batch)
        if t_now_ns - self._t_tended_ns >= TEND_AFTER_NS:
            self._tend(t_now_ns)

    def _pass(self, t_now_ns: int, batch: Sequence[RawReport] = ()) -> None:
        """Track, predict, solve and send. Whatever fails in it ends in silence, not in a reference that stands."""
        if self.session.is_resting and len(batch) > 0:
            self._wake(t_now_ns)
        ahead_ns = self.session.latency.link_ns  # from the pass's beginning, so computing is in it
        try:
            tick = self._decide(batch, t_now_ns, ahead_ns)
            self.is_failing = False
        except Exception:
            if not self.is_failing:  # once, not ninety times a second
                log.exception("a pass failed: the plate is quiet until one succeeds")
            self.is_failing = True
            tick = self.pipeline.rest(t_now_ns, ahead_ns)
        self.last_tick = tick
        if tick.drive is not None:
            self._say(self.session.reference(tick.drive, tick, t_now_ns), t_now_ns)
        if self.tap is not None:
            self.tap("pass", t_now_ns, tick, self.supervisor.state.name, self.pipeline.fingers)
        if self.publish is None:
            self.skipped_no_subscriber += 1
        else:
            self.published += 1
            self.publish(status.telemetry(self, tick))
        if self.markers:
            self.markers.clear()

    def _decide(self, batch: Sequence[RawReport], t_now_ns: int, ahead_ns: int) -> Tick:
        for report in batch:
            for frame in self.trackpad.decode(report.data, report.t_host_ns):
                self.pipeline.touch(frame, report.t_host_ns)
        keys = self.pipeline.wanted(t_now_ns)
        self._supervise(Event.TOUCHED if keys else Event.RELEASED, "", t_now_ns)
        if not self.supervisor.may_drive:
            return self.pipeline.rest(t_now_ns, ahead_ns)
        if not (self.session.follows(t_now_ns) or self.session.is_resting):
            self.pipeline.forget_standing()  # what the board did not take is said again, until it does
        return self.pipeline.drive(t_now_ns, ahead_ns, keys)

    def timer(self, t_now_ns: int) -> None:
        """Due every TIMER_NS: targets expire, a silent pad lifts its fingers, the board is kept alive; and where no
        report makes a pass, virtual fingers walk on. At rest all that is looked at every LOOK_EVERY_NS, and in between
        the board hears that its reference stands."""
        if self.tap is not None:
            self.tap("timer", t_now_ns)
        if self._rests(t_now_ns):
            if not self.session.is_resting:
                self._say(self.session.keep_alive(t_now_ns), t_now_ns)
            return
        self._tend(t_now_ns)
        if self.session.is_resting and not self.markers:
            return
        if self.t_reports_ns is None or t_now_ns - self.t_reports_ns >= REPORTS_ENDED_NS:
            self._pass(t_now_ns)

    def _tend(self, t_now_ns: int) -> None:
        """All that time alone brings about."""
        self._t_looked_ns = self._t_tended_ns = t_now_ns
        self._rest_or_wake(t_now_ns)
        released = self.scene.expire(t_now_ns)
        if released:
            self.pipeline.release(released)
        if self.pipeline.sensor_is_silent(t_now_ns):
            log.warning("trackpad silent with %d fingers down: they count as lifted", len(self.pipeline.fingers))
            self.pipeline.sensor_lost()
        was_accepted = self.session.hello is not None
        commands = self.session.timer(t_now_ns)
        if was_accepted and self.session.hello is None:
            log.warning("board: it has fallen silent; it is greeted until it answers")
        self._say(commands, t_now_ns)  # which may find that the port is gone
        if self.session.ready:
            self._supervise(Event.LINK_UP, "the board answers and its clock is known", t_now_ns)
        else:
            self._supervise(Event.LINK_DOWN, "the board does not answer", t_now_ns)

    def _rest_or_wake(self, t_now_ns: int) -> None:
        """A board that nobody wanted for REST_AFTER_NS is left quiet, and armed again as soon as somebody does."""
        if not self._is_unwanted():
            self._wake(t_now_ns)
        elif not self.session.follows(t_now_ns):
            self._t_wanted_ns = t_now_ns  # it rests, or has to be armed first
        elif t_now_ns - self._t_wanted_ns >= REST_AFTER_NS:
            self._t_wanted_ns = t_now_ns  # should the line lose it, it is said again after as long
            self._say(self.session.rest(t_now_ns), t_now_ns)

    def _wake(self, t_now_ns: int) -> None:
        self._t_wanted_ns = t_now_ns
        self._say(self.session.wake(t_now_ns), t_now_ns)

    def trackpad_link(self, up: bool, reason: str, t_now_ns: int, *, model: str | None = None) -> None:
        """The trackpad came or went; `model` says which one it is, where that was not configured."""
        if self.tap is not None:
            self.tap("trackpad_link", t_now_ns, up, reason, model)
        log.log(logging.INFO if up else logging.WARNING, "trackpad: %s", reason)
        if model is not None and model != self.trackpad.model:
            self.trackpad = trackpad_wire.Decoder(model, plate_from_pad(self.config))
        self.trackpad.reset()
        self.pipeline.sensor_lost()
        self._supervise(Event.SENSOR_UP if up else Event.SENSOR_DOWN, reason, t_now_ns)
        self._pass(t_now_ns)

    # --- the board ---

    def board_link(self, up: bool, reason: str, t_now_ns: int) -> None:
        """The serial port came or went."""
        if self.tap is not None:
            self.tap("board_link", t_now_ns, up, reason)
        log.log(logging.INFO if up else logging.WARNING, "board: %s", reason)
        self.board = device_wire.Decoder()
        self.refused_board = ""
        if up:
            self._say(self.session.link_up(t_now_ns), t_now_ns)
        else:
            self.session.link_down()
            self._supervise(Event.LINK_DOWN, reason, t_now_ns)

    def board_bytes(self, data: bytes, t_now_ns: int) -> None:
        """What the board said."""
        if self.tap is not None:
            self.tap("board_bytes", t_now_ns, data)
        was_accepted = self.session.hello is not None
        for message in self.board.feed(data):
            self._hear(message, t_now_ns)
        self._say(self.session.resume(t_now_ns), t_now_ns)
        if was_accepted and self.session.hello is None:
            log.warning("board: its clock is another than before, as after a reset; it is greeted anew")

    def _hear(self, message: BoardMessage | ToolMessage, t_now_ns: int) -> None:
        match message:
            case BoardTime():
                self.session.receive_time(message, t_now_ns)
            case BoardHello():
                self._greet(message, t_now_ns)
            case BoardStatus():
                self._take_status(message, t_now_ns)
            case BoardVerdict(request, verdict):
                if verdict is not Verdict.DONE:
                    log.error("board: it refused %s", protocol.COMMANDS.get(request, f"message {request:#04x}"))
                if request in (protocol.MSG_SET_CONTROLLER, protocol.MSG_SET_MODEL):
                    self._say(self.session.receive_answer(t_now_ns), t_now_ns)
            case _:
                pass  # answers to a person at the bench

    def _greet(self, hello: BoardHello, t_now_ns: int) -> None:
        try:
            device_wire.check_hello(
                hello, modes=len(self.config.limits.w_limit_um), w_limit_um=self.config.limits.w_limit_um
            )
            device_wire.check_calibration(hello, self.calibration)
        except DeviceError as error:
            if str(error) != self.refused_board:
                log.error("board refused: %s", error)
                self.refused_board = str(error)
            return
        self.refused_board = ""
        if hello != self.session.hello:  # else it was only sent to rest
            log.info("board: firmware %s, boot %08x, %d modes", hello.firmware_version, hello.boot_id, hello.modes)
        self._say(self.session.receive_hello(hello, t_now_ns), t_now_ns)

    def _take_status(self, message: BoardStatus, t_now_ns: int) -> None:
        booked = self.session.ledger.age.count
        self.session.receive_status(message, t_now_ns)
        if self.tap is not None:
            self.tap("status", t_now_ns, message)
            if self.session.ledger.age.count != booked:
                self.tap("ledger", t_now_ns, self.session.ledger[-1])
        if self.session.hello is None:
            return  # who has not been accepted is not believed
        if message.state is BoardState.FAULT:
            cause = protocol.FAULTS.get(message.fault_code, f"its code is {message.fault_code}")
            self._supervise(Event.BOARD_FAULT, cause, t_now_ns)
        elif self._t_clear_until_ns is not None and t_now_ns <= self._t_clear_until_ns:
            self._t_clear_until_ns = None
            self._supervise(Event.CLEARED, "a client cleared it", t_now_ns)

    def stop(self, t_now_ns: int) -> None:
        """Leave a quiet plate: the last thing that is said."""
        if self.tap is not None:
            self.tap("stop", t_now_ns)
        self._supervise(Event.STOP, "stopping", t_now_ns)
        tick = self.pipeline.rest(t_now_ns, 0)
        if tick.drive is not None:
            self._say(self.session.reference(tick.drive, tick, t_now_ns), t_now_ns)

    def take_leave(self, t_now_ns: int) -> bool:
        """End the session with a board that has come to rest, so that its dead-man does not trip: three trips in ten
        seconds latch, and configurations may be read anew as often. False where there is no session."""
        if self.tap is not None:
            self.tap("take_leave", t_now_ns)
        if self.session.hello is None:
            return False
        self._say([HelloRequest()], t_now_ns)
        return True

    def _say(self, commands: Sequence[BoardCommand], t_now_ns: int) -> None:
        for command in commands:
            line = FRESH_START + encode(command)
            is_accepted = self._write_board(line)
            if self.tap is not None:
                self.tap("written", t_now_ns, line, is_accepted)
            if not is_accepted:
                self.unsent += 1
                self.pipeline.forget_standing()  # the board may hold another reference than is believed

    def _supervise(self, event: Event, reason: str, t_now_ns: int) -> None:
        before = self.supervisor.state
        after = self.supervisor.handle(event, reason, t_now_ns)
        if after is before:
            return
        if after is State.FAULT:
            log.error("board fault: %s; the plate stays quiet until a client clears it", reason)
        elif event is Event.CLEARED:
            log.info("board fault left: %s", reason)
        else:  # each touch is one, and what matters of the others was said where it happened
            log.debug("%s -> %s%s", before.name, after.name, f": {reason}" if reason else "")

    # --- the clients ---

    def targets(self, payload: bytes, t_now_ns: int, user: str = "") -> None:
        """A message of the targets socket, sent by `user`; what is wrong with it is counted and kept for `status`."""
        if self.tap is not None:
            self.tap("targets", t_now_ns, payload, user)
        try:
            message = client_wire.decode_targets(payload)
            refusals = self._apply(message, t_now_ns) if self._is_newest(message, user, t_now_ns) else ()
        except RequestError as error:
            refusals = (str(error),)
        if refusals:
            self.messages_refused += 1
            self.last_refusal = refusals[0]

    def want(self, message: ClientTargets, t_now_ns: int) -> tuple[str, ...]:
        """Put the targets of a client that speaks in values in force; sentences for what it may not have."""
        if self.tap is not None:
            self.tap("targets", t_now_ns, message, "")
        return self._apply(message, t_now_ns)

    def _apply(self, message: ClientTargets, t_now_ns: int) -> tuple[str, ...]:
        """What a client wants is in force; a board that rests is armed for it now."""
        refusals = self.scene.apply(message, t_now_ns)
        if self.session.is_resting:
            self._rest_or_wake(t_now_ns)
        return refusals

    def request(self, payload: bytes, t_now_ns: int, user: str = "") -> bytes:
        """Answer a message of the control socket, sent by `user`."""
        if self.tap is not None:
            self.tap("request", t_now_ns, payload, user)
        return client_wire.answer(payload, lambda request: self._carry_out(request, t_now_ns, user))

    def _is_newest(self, message: ClientTargets | client_wire.Release, user: str, t_now_ns: int) -> bool:
        """False where a newer message of the same client came first. Raises RequestError for another user's name."""
        ttl_ns = message.ttl_ns if isinstance(message, ClientTargets) else 0
        is_newest = self.clientele.is_newest(message.client, user, message.stamp, ttl_ns, t_now_ns)
        self.messages_overtaken += not is_newest
        return is_newest

    def _carry_out(self, request: client_wire.Request, t_now_ns: int, user: str) -> Mapping[str, object]:
        if isinstance(request.body, client_wire.Marker):
            return self._mark(replace(request.body, t_ns=t_now_ns))
        if request.body is not None and not self._is_newest(request.body, user, t_now_ns):
            raise RequestError("A newer message of this client came before this one: nothing was changed.")
        if isinstance(request.body, ClientTargets):
            refusals = self._apply(request.body, t_now_ns)
            if refusals:
                raise RequestError(" ".join(refusals))
            return {}
        if isinstance(request.body, client_wire.Release):
            return {"released": self._release(request.body)}
        if request.op == "clear_fault":
            self._clear_fault(t_now_ns)
            return {}
        if request.op == "status":
            return self.report_status(t_now_ns)
        if request.op == "plate":
            return status.plate(self)
        return {"version": __version__, "instance": self.instance, **client_wire.CAPABILITIES}

    def _mark(self, marker: client_wire.Marker) -> Mapping[str, object]:
        if self.tap is not None:
            self.tap("marker", marker.t_ns, marker.client, marker.text)
        if len(self.markers) < MAX_MARKERS:
            self.markers.append(marker)
        return {"t_ns": marker.t_ns}

    def _clear_fault(self, t_now_ns: int) -> None:
        if self.supervisor.state is not State.FAULT:
            return
        if not self.session.ready:
            raise RequestError("The board does not answer, so its fault cannot be cleared: connect it first.")
        self._t_clear_until_ns = t_now_ns + CLEAR_WITHIN_NS
        self._say([ClearFault()], t_now_ns)

    def _release(self, release: client_wire.Release) -> bool:
        if release.finger is None:
            self.scene.release_client(release.client)
            return True
        return self.scene.release(release.client, release.finger)

    def report_status(self, t_now_ns: int) -> dict[str, object]:
        """What `hapticd`'s clients see of its inner life."""
        return status.collect(self, t_now_ns)

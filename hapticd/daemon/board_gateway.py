"""The board as the machine meets it: its bytes become messages, the session's answers become lines.

Here a hello is judged, a refusal, a fault or a silence becomes a sentence of the log and an event for the supervisor,
and each line is counted that the port did not take. What is said when, the session decides (`core.board.session`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence

from ..board_values import (
    BoardCommand,
    BoardHello,
    BoardMessage,
    BoardState,
    BoardStatus,
    BoardTime,
    BoardVerdict,
    ClearFault,
    HelloRequest,
    ModeCalibration,
    ToolMessage,
    Verdict,
)
from ..config.sections import Config
from ..core.board.session import BoardSession
from ..core.board.supervisor import Event
from ..errors import DeviceError, RequestError
from ..values import Tick
from ..wire import device as device_wire
from ..wire import protocol
from ..wire.commands import encode
from .observer import Observer

log = logging.getLogger("hapticd")

REST_AFTER_NS = 2_000_000_000  # of being wanted by nobody: then the board is left quiet, and kept alive no more
CLEAR_WITHIN_NS = 500_000_000  # the board agrees at once, or the fault persists
FRESH_START = b"\0"  # ends what a frame cut short left on the line, which would else take this one with it
# A pass on a slow machine, until frames were acknowledged: their delay, from the pass's beginning on, contains it.
START_COMPUTE_NS = 400_000
# The board's look-ahead laws read the reference 0.55 ms before they play it. Frames do not come earlier for that: to
# predict so much farther ahead leaks 0.7 % more (strokes, seeds 1 to 5) than to miss the first tick of each.


class BoardGateway:
    """The board at the other end of the line, whichever is plugged in."""

    def __init__(
        self,
        config: Config,
        calibration: Sequence[ModeCalibration],
        *,
        write: Callable[[bytes], bool],
        on_unsent: Callable[[], None],
        supervise: Callable[[Event, str, int], None],
    ) -> None:
        """`write` says whether the port took a line, `on_unsent` is called where it did not; `supervise` hears of
        events, with their reason and instant."""
        self.session = BoardSession(
            link_start_ns=round(config.device.link_ms * 1e6) + START_COMPUTE_NS,
            controller=config.device.controller,
            calibration=calibration,
        )
        self.unsent = 0
        self.refused = ""  # why the board that is there is not accepted
        self.write = write
        self.observer: Observer | None = None
        self._w_limit_um = config.limits.w_limit_um
        self._calibration = calibration
        self._on_unsent = on_unsent
        self._supervise = supervise
        self._decoder = device_wire.Decoder()
        self._t_clear_until_ns: int | None = None
        self._t_wanted_ns = 0

    @property
    def dropped(self) -> Mapping[str, int]:
        """What was no message, by kind, since the port was opened."""
        return self._decoder.counters

    # --- what it says ---

    def link(self, up: bool, reason: str, t_now_ns: int) -> None:
        """The serial port came or went."""
        log.log(logging.INFO if up else logging.WARNING, "board: %s", reason)
        self._decoder = device_wire.Decoder()
        self.refused = ""
        if up:
            self._say(self.session.link_up(t_now_ns), t_now_ns)
        else:
            self.session.link_down()
            self._supervise(Event.LINK_DOWN, reason, t_now_ns)

    def receive(self, data: bytes, t_now_ns: int) -> None:
        """Bytes from the line, however they were cut."""
        was_accepted = self.session.hello is not None
        for message in self._decoder.feed(data):
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
            device_wire.check_hello(hello, modes=len(self._w_limit_um), w_limit_um=self._w_limit_um)
            device_wire.check_calibration(hello, self._calibration)
        except DeviceError as error:
            if str(error) != self.refused:
                log.error("board refused: %s", error)
                self.refused = str(error)
            return
        self.refused = ""
        if hello != self.session.hello:  # else it was only sent to rest
            log.info("board: firmware %s, boot %08x, %d modes", hello.firmware_version, hello.boot_id, hello.modes)
        self._say(self.session.receive_hello(hello, t_now_ns), t_now_ns)

    def _take_status(self, message: BoardStatus, t_now_ns: int) -> None:
        booked = self.session.ledger.age.count
        self.session.receive_status(message, t_now_ns)
        if self.observer is not None:
            self.observer("status", t_now_ns, message)
            if self.session.ledger.age.count != booked:
                self.observer("ledger", t_now_ns, self.session.ledger[-1])
        if self.session.hello is None:
            return  # who has not been accepted is not believed
        if message.state is BoardState.FAULT:
            cause = protocol.FAULTS.get(message.fault_code, f"its code is {message.fault_code}")
            self._supervise(Event.BOARD_FAULT, cause, t_now_ns)
        elif self._t_clear_until_ns is not None and t_now_ns <= self._t_clear_until_ns:
            self._t_clear_until_ns = None
            self._supervise(Event.CLEARED, "a client cleared it", t_now_ns)

    # --- what it is told ---

    def follow(self, tick: Tick, t_now_ns: int) -> None:
        """The reference that a pass decided on, if another than the one that stands."""
        if tick.drive is not None:
            self._say(self.session.reference(tick.drive, tick, t_now_ns), t_now_ns)

    def keep_alive(self, t_now_ns: int) -> None:
        """What it must hear at rest, its reference standing."""
        self._say(self.session.keep_alive(t_now_ns), t_now_ns)

    def tend(self, t_now_ns: int) -> None:
        """All that time alone brings about: greetings, questions, keep-alives, and notice of a board that is silent."""
        was_accepted = self.session.hello is not None
        commands = self.session.timer(t_now_ns)
        if was_accepted and self.session.hello is None:
            log.warning("board: it has fallen silent; it is greeted until it answers")
        self._say(commands, t_now_ns)  # which may find that the port is gone
        if self.session.ready:
            self._supervise(Event.LINK_UP, "the board answers and its clock is known", t_now_ns)
        else:
            self._supervise(Event.LINK_DOWN, "the board does not answer", t_now_ns)

    def rest_or_wake(self, is_wanted: bool, t_now_ns: int) -> None:
        """A board that nobody wanted for REST_AFTER_NS is left quiet, and armed again as soon as somebody does."""
        if is_wanted:
            self.wake(t_now_ns)
        elif not self.session.follows(t_now_ns):
            self._t_wanted_ns = t_now_ns  # it rests, or has to be armed first
        elif t_now_ns - self._t_wanted_ns >= REST_AFTER_NS:
            self._t_wanted_ns = t_now_ns  # should the line lose it, it is said again after as long
            self._say(self.session.rest(t_now_ns), t_now_ns)

    def wake(self, t_now_ns: int) -> None:
        """Somebody wants it: arm it, if it rests."""
        self._t_wanted_ns = t_now_ns
        self._say(self.session.wake(t_now_ns), t_now_ns)

    def clear_fault(self, t_now_ns: int) -> None:
        """Ask it to leave its fault; its next status says whether the cause is gone. Raises RequestError."""
        if not self.session.ready:
            raise RequestError("The board does not answer, so its fault cannot be cleared: connect it first.")
        self._t_clear_until_ns = t_now_ns + CLEAR_WITHIN_NS
        self._say([ClearFault()], t_now_ns)

    def disconnect(self, t_now_ns: int) -> bool:
        """End the session with a board that has come to rest, so that its dead-man does not trip: three trips in ten
        seconds latch, and configurations may be read anew as often. False where there is no session."""
        if self.session.hello is None:
            return False
        self._say([HelloRequest()], t_now_ns)
        return True

    def _say(self, commands: Sequence[BoardCommand], t_now_ns: int) -> None:
        for command in commands:
            line = FRESH_START + encode(command)
            is_accepted = self.write(line)
            if self.observer is not None:
                self.observer("written", t_now_ns, line, is_accepted)
            if not is_accepted:
                self.unsent += 1
                self._on_unsent()  # the board may hold another reference than is believed

"""Board gateway: the board's bytes become messages, the session's commands become lines.

Checks the hello, turns refusals, faults and silence into log lines and supervisor events, and counts the lines that the
port did not take. What is sent when is decided by the session (`core.board.session`).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence

from .. import board_protocol as protocol
from ..board_protocol import (
    BoardState,
    BoardTime,
    BoardVerdict,
    ClearFault,
    CommandResult,
    HelloRequest,
    SetBaud,
)
from ..board_values import BoardCalibration, BoardCommand, BoardHello, BoardStatus
from ..config.sections import SIMULATED, Config
from ..core.board.session import SILENT, STOPPED_AFTER_NS, BoardSession
from ..core.board.supervisor import Event
from ..errors import DeviceError, RequestError
from ..values import Tick
from ..wire import device as device_wire
from ..wire.commands import encode
from ..wire.device import FLASH
from .observer import Observed
from .settings import LONGEST_FRAME_S, MOST_KNOTS, max_knots

log = logging.getLogger("hapticd")

STANDBY_AFTER_NS = 2_000_000_000  # without activity: keep-alives stop after this idle time
CLEAR_WITHIN_NS = 500_000_000  # the board agrees at once, or the fault persists
INCOMPLETE_AFTER_NS = 1_500_000_000  # a handshake takes a tenth of that: then a sentence says what it lacks
FRESH_START = b"\0"  # ends a frame that was cut short, which would otherwise take this one with it
# A pass on a slow machine, until frames were acknowledged: their delay, from the pass's beginning on, contains it.
START_COMPUTE_NS = 400_000
START_LINK_NS = 5_000_000  # delay of the link until it is measured
FAST_BAUD = 3_000_000  # of a board that offers it
LACK_OF = {"VERDICT": " on its controller and models", "TIME": " that continues its clock"}
CHECK_THE_LINE = "check device.port, device.baud, the cable and the board's supply"
EASE_THE_COMPUTER = "it is simulated, and this computer too busy for it: close other programs"
PASSED, MOVED, UNSAFE, UNKNOWN, RUNNING = "passed", "moved", "unsafe", "unknown", "running"  # outcomes of a self-test
# The board's look-ahead laws read the reference 0.55 ms before they play it. Frames do not come earlier for that: to
# predict so much farther ahead leaks 0.7 % more (strokes, seeds 1 to 5) than to miss the first tick of each.


class BoardGateway:
    """The board at the other end of the line."""

    def __init__(
        self,
        config: Config,
        calibration: BoardCalibration,
        *,
        write: Callable[[bytes], int | None],
        set_baud: Callable[[int], None] | None = None,
        invalidate_reference: Callable[[], None],
        supervise: Callable[[Event, str, int], None],
        observed: Observed,
    ) -> None:
        """`write` returns when the port took a line, None where it did not. `set_baud` sets the port's speed; without
        it no other is requested. `invalidate_reference` lets the next pass send its reference, even if it still holds.
        `supervise` receives events, with their reason and instant.
        """
        self.session = BoardSession(
            link_start_ns=START_LINK_NS + START_COMPUTE_NS,
            controller=config.device.controller,
            calibration=calibration,
            telemetry_hz=config.record.telemetry_hz,
            fast_baud=0 if set_baud is None else FAST_BAUD,
        )
        self.unsent = 0
        self.refused = ""  # why the present board is not accepted
        self.lacking = ""  # what a handshake lacks that should be complete
        self.self_test: tuple[str, str] | None = None  # outcome and sentence; None: none was requested
        # Of a board that says nothing, one that says something else, and one of another version.
        real, simulated = (
            (CHECK_THE_LINE, FLASH, FLASH),
            (EASE_THE_COMPUTER, EASE_THE_COMPUTER, "install hapticd again"),
        )
        self._check_line, self._check_firmware, self._replace = simulated if config.device.port == SIMULATED else real
        self.write = write
        self._first_baud = self.baud = config.device.baud
        self._set_baud = set_baud
        self._t_pulse_ns = -protocol.PULSE_EVERY_NS
        self._config = config
        self._w_limit_um = config.limits.w_limit_um
        self._calibration = calibration
        self._invalidate_reference = invalidate_reference
        self._observed = observed
        self._supervise = supervise
        self._decoder = device_wire.Decoder()
        self._t_clear_until_ns: int | None = None
        self._t_active_ns = 0
        self._t_complete_ns: int | None = None  # when the handshake was last complete, or began; None: no port
        self._t_tended_ns = 0
        self._reported = ""  # the message that a logged handshake lacked

    @property
    def dropped(self) -> Mapping[str, int]:
        """Bytes that were no message, by kind, since the port was opened."""
        return self._decoder.counters

    def take_self_test(self, outcome: str, text: str) -> None:
        """Take note of a self-test. After an UNSAFE one no handshake is completed."""
        self.self_test = outcome, text
        level = {PASSED: logging.INFO, RUNNING: logging.INFO, UNSAFE: logging.ERROR}.get(outcome, logging.WARNING)
        log.log(level, "self-test: %s", text)

    # --- receiving ---

    def link(self, up: bool, reason: str, t_now_ns: int) -> None:
        """Take note that the serial port was opened or lost."""
        log.log(logging.INFO if up else logging.WARNING, "board: %s", reason)
        self._decoder = device_wire.Decoder()
        self.refused = self.lacking = self._reported = ""
        self._t_complete_ns = t_now_ns if up else None
        self.baud = self._first_baud  # of a port that was opened again
        if up:
            self._send(self.session.link_up(t_now_ns), t_now_ns)
        else:
            self.session.link_down()
            self._supervise(Event.LINK_DOWN, reason, t_now_ns)

    def receive(self, data: bytes, t_now_ns: int) -> None:
        """Take bytes from the line, in pieces of any size."""
        was_accepted = self.session.hello is not None
        for message in self._decoder.feed(data):
            match message:
                case BoardStatus():  # first: one comes for each report
                    self._take_status(message, t_now_ns)
                case BoardTime():
                    self.session.receive_time(message, t_now_ns)
                case BoardHello():
                    self._check_hello(message, t_now_ns)
                case BoardVerdict():
                    self._take_verdict(message, t_now_ns)
                case _:
                    pass  # answers to a bench tool
        self._send(self.session.resume(t_now_ns), t_now_ns)
        if was_accepted and self.session.hello is None:
            log.warning("board: %s", self.session.ended)

    def _take_verdict(self, answer: BoardVerdict, t_now_ns: int) -> None:
        """Send the next setting, if this one was taken. A board that refuses one is not driven."""
        setting, is_taken = self.session.setting, answer.verdict is CommandResult.DONE
        is_awaited = setting is not None and setting.kind == answer.request
        if is_awaited:
            self._send(self.session.receive_answer(t_now_ns, is_taken=is_taken), t_now_ns)
        what = protocol.COMMANDS.get(answer.request, f"message {answer.request:#04x}")
        is_needed = not isinstance(setting, SetBaud)  # without another speed the session goes on
        why = protocol.VERDICTS[answer.verdict.value]
        refusal = "" if is_taken or not is_needed else f"The board refuses {what}: {why}."
        if refusal and refusal != self.refused:
            log.error("board refused: %s", refusal)
        if is_awaited:
            self.refused = refusal

    def _check_hello(self, hello: BoardHello, t_now_ns: int) -> None:
        try:
            modes, limits = len(self._w_limit_um), self._w_limit_um
            device_wire.check_hello(hello, modes=modes, w_limit_um=limits, remedy=self._replace)
            device_wire.check_calibration(hello, self._calibration)
            if self.self_test is not None and self.self_test[0] == UNSAFE:
                raise DeviceError(self.self_test[1])
        except DeviceError as error:
            if str(error) != self.refused:
                log.error("board refused: %s", error)
                self.refused = str(error)
            return
        self.refused = ""
        is_new = hello != self.session.hello  # else it only answered the request for standby
        if is_new:
            log.info("board: firmware %s, boot %08x, %d modes", hello.firmware_version, hello.boot_id, hello.modes)
        self._send(self.session.receive_hello(hello, t_now_ns), t_now_ns)
        if is_new and not isinstance(self.session.setting, SetBaud):  # on the line that the session stays on
            self._report_knots(hello.modes)

    def _report_knots(self, modes: int) -> None:
        """Log where the line is too slow for frames of MOST_KNOTS."""
        knots = max_knots(self._config, self.baud)
        if knots < MOST_KNOTS:
            within_ms = 1e3 * LONGEST_FRAME_S
            slow = "a reference frame of %d modes has %d knots, not %d: at %d baud more take over %g ms"
            log.info(f"board: {slow}", modes, knots, MOST_KNOTS, self.baud, within_ms)

    def _take_status(self, message: BoardStatus, t_now_ns: int) -> None:
        booked, observer = self.session.receive_status(message, t_now_ns), self._observed.observer
        if observer is not None:
            observer("status", t_now_ns, message)
            if booked is not None:
                observer("ledger", t_now_ns, booked)
        if self.session.hello is None:
            return  # before the handshake no status counts
        if message.state is BoardState.FAULT:
            cause = protocol.FAULTS.get(message.fault_code, f"its code is {message.fault_code}")
            self._supervise(Event.BOARD_FAULT, cause, t_now_ns)
        elif self._t_clear_until_ns is not None and t_now_ns <= self._t_clear_until_ns:
            self._t_clear_until_ns = None
            self._supervise(Event.CLEARED, "a client cleared it", t_now_ns)

    # --- sending ---

    def follow(self, tick: Tick, t_now_ns: int) -> int | None:
        """Send the reference that a pass decided on, if it is another than the one that stands; return when the port
        took it."""
        return None if tick.drive is None else self._send(self.session.reference(tick.drive, tick, t_now_ns), t_now_ns)

    def keep_alive(self, t_now_ns: int) -> None:
        """Send the keep-alive that is due while the reference holds."""
        self._send(self.session.keep_alive(t_now_ns), t_now_ns)

    def tend(self, t_now_ns: int) -> None:
        """Do what is due by time alone: hello and time requests, keep-alives, and detection of a silent board."""
        was_accepted = self.session.hello is not None
        was_fast = self.session.line.baud
        if self.session.lacks_last(t_now_ns):
            self._invalidate_reference()
        commands = self.session.timer(t_now_ns)
        if was_fast and not self.session.line.baud:
            log.warning("board: %s", self.session.ended)
        elif was_accepted and self.session.hello is None:
            self.lacking = self.session.ended
            self._reported = "HELLO" if self.session.ended == SILENT else "STATUS"
            log.warning("board: %s", self.session.ended)
        self._send(commands, t_now_ns)  # may find that the port is gone
        self._report_lack(t_now_ns)
        if self.session.ready:
            self._supervise(Event.LINK_UP, "the board answers and its clock is known", t_now_ns)
        else:
            self._supervise(Event.LINK_DOWN, "the board does not answer", t_now_ns)

    def _report_lack(self, t_now_ns: int) -> None:
        """Log once what an incomplete handshake lacks, and when it is complete again. A refusal was logged before."""
        awaited, was_stopped = self.session.awaited, t_now_ns - self._t_tended_ns > STOPPED_AFTER_NS
        self._t_tended_ns = t_now_ns
        if self._t_complete_ns is None:
            return
        if was_stopped:
            self._t_complete_ns = t_now_ns
        if not awaited or self.refused:
            if not awaited and self._reported not in ("", "HELLO"):  # whose arrival has a line of its own
                log.info("board: its %s has arrived: references are sent", self._reported)
            self.lacking = self._reported = ""
            self._t_complete_ns = t_now_ns
        elif t_now_ns - self._t_complete_ns > INCOMPLETE_AFTER_NS and awaited != self._reported:
            self._tune_line()  # a core before this one may have left the port at a speed that its board has lost
            self._reported = awaited
            self.lacking = f"not driven: {self._lack(awaited)}"
            log.warning("board: %s", self.lacking)

    def _lack(self, awaited: str) -> str:
        """Return what the board does not send, and what to check."""
        is_invalid = getattr(protocol, f"MSG_{awaited}") in self._decoder.invalid_types
        remedy = self._check_line if awaited == "HELLO" and not is_invalid else self._check_firmware
        return f"it sends no {'valid ' if is_invalid else ''}{awaited}{LACK_OF.get(awaited, '')}: {remedy}"

    def standby_or_wake(self, is_active: bool, t_now_ns: int) -> None:
        """Put the board on standby after STANDBY_AFTER_NS without activity, and arm it as soon as there is some."""
        if is_active:
            self.wake(t_now_ns)
        elif not self.session.follows(t_now_ns):
            self._t_active_ns = t_now_ns  # it is on standby, or has to be armed first
        elif t_now_ns - self._t_active_ns >= STANDBY_AFTER_NS:
            self._t_active_ns = t_now_ns  # if the line loses it, it is sent again after the same time
            self._send(self.session.standby(t_now_ns), t_now_ns)

    def wake(self, t_now_ns: int) -> None:
        """Arm the board, if it is on standby."""
        self._t_active_ns = t_now_ns
        self._send(self.session.wake(t_now_ns), t_now_ns)

    def clear_fault(self, t_now_ns: int) -> None:
        """Ask the board to clear its fault; its next status shows whether the cause is gone. Raises RequestError."""
        if not self.session.ready:
            raise RequestError("The board does not answer, so its fault cannot be cleared: connect it first.")
        self._t_clear_until_ns = t_now_ns + CLEAR_WITHIN_NS
        self._send([ClearFault()], t_now_ns)

    def pulse(self, t_now_ns: int) -> None:
        """Mark the next reference for the sync output, and see that there is one. Raises RequestError."""
        hello = self.session.hello
        if hello is None or not self.session.ready:
            raise RequestError("The board does not answer, so its sync output cannot rise: connect it first.")
        if not hello.has_sync:
            raise RequestError("This board has no sync output: leave `pulse` out, or flash a firmware that has one.")
        if self.session.must_pulse or t_now_ns - self._t_pulse_ns < protocol.PULSE_EVERY_NS:
            raise RequestError("The sync output rises at most every 20 ms: leave as much time between pulses.")
        self._t_pulse_ns = t_now_ns
        self.session.must_pulse = True
        self.wake(t_now_ns)
        self._invalidate_reference()

    def _tune_line(self) -> None:
        """Give the port the speed that the session has come to."""
        if self._set_baud is not None:
            before, self.baud = self.baud, self.session.line.baud or self._first_baud
            self._set_baud(self.baud)
            if self.baud != before:
                log.info("board: the line goes on at %d baud", self.baud)

    def disconnect(self, t_now_ns: int) -> bool:
        """End the session with a quiet board without a dead-man trip: three trips in ten seconds latch, and a
        configuration may be reloaded as often. False where there is no session."""
        if self.session.hello is None:
            return False
        slower = [SetBaud(self._first_baud)] if self.session.line.baud else []  # for the next daemon's hello
        self._send([HelloRequest(), *slower], t_now_ns)
        return True

    def _send(self, commands: Sequence[BoardCommand], t_now_ns: int) -> int | None:
        """Write commands; return when the port took the last one, None where it did not."""
        t_written_ns = None
        if (self.session.line.baud or self._first_baud) != self.baud:
            self._tune_line()
        for command in commands:
            line = FRESH_START + encode(command)
            t_written_ns = self.write(line)
            if self._observed.observer is not None:
                self._observed.put("written", t_now_ns, line, t_written_ns is not None)
            if t_written_ns is None:
                self.unsent += 1
                self._invalidate_reference()  # the board may hold another reference than expected
        return t_written_ns

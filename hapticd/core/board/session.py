"""Board session: handshake, clock synchronisation, numbered frames, keep-alives, and the latency ledger.

Messages and instants in, commands out. A hello is requested when the link comes up, and again when the board stays
silent or reboots. References are sent only once the hello was accepted, the clock is known, the board has taken the
settings of its controller and its modes, one by one, and it sends its status.

While nothing is driven the session may go to `standby`: after a last hello request the board is quiet and needs no
keep-alives. It keeps clock, controller and models, so `wake` takes one write and no answer.

A board that does not answer is sent no more than the send window allows, and nothing once its status is overdue. Of the
references held back only the newest is kept, and is sent when the board answers again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ... import board_protocol as protocol
from ...board_protocol import BoardState, BoardTime, HelloRequest, Keepalive, SetBaud, TimeRequest
from ...board_values import (
    UNCALIBRATED,
    BoardCalibration,
    BoardCommand,
    BoardHello,
    BoardSetting,
    BoardStatus,
    ReferenceFrame,
)
from ...values import LedgerLine, SafeDrive, Tick
from ..trajectory.gate import silence
from .handshake import FAILED, BoardSettings, LineSpeed
from .ledger import Ledger
from .link import BoardClock, Flight, LinkLatency, SendWindow

GREET_EVERY_NS: Final = 250_000_000
SETTLE_TIME_EVERY_NS: Final = 20_000_000  # until the clock is known
TIME_EVERY_NS: Final = 500_000_000
LEAP_US: Final = 2_000_000  # between two statuses: the board was reset
CLOCK_WRAP_US: Final = 1 << 32
KEEP_ALIVE_AFTER_NS: Final = 12_500_000  # without a command: with a timer of 10 ms one goes every 20
ARM_EVERY_NS: Final = 20_000_000  # slower than references come: zero frames must not come between them
ANSWER_WITHIN_NS: Final = 10_000_000  # beyond the round trip: then a reference was lost, and is sent again
OVERDUE_NS: Final = 5_000_000  # beyond the round trip: then an answer is missing
MUTE_AFTER_NS: Final = 150_000_000  # without a status, which comes every 100 ms: what is sent may never be read
SILENT_AFTER_NS: Final = 1_000_000_000  # then the handshake starts again
STOPPED_AFTER_NS: Final = 600_000_000  # between two timers: the host was stopped, and has not read what the board sent
RENEW_AFTER_NS: Final = 3_000_000_000  # of a reference that holds: the board drops one of 10 s that moves the plate
COMPARABLE_AFTER_NS: Final = 1_000_000_000  # after that: until then two statuses may lie either side of a full buffer
SENSELESS_TIMES: Final = 3  # replies in a row whose own times contradict each other: noise makes no more

# Why a session ended, for the log.
DISCONTINUITY: Final = "Clock discontinuity (board reset?): reconnecting"
SILENT: Final = "silent; requesting its hello until it answers"
NO_STATUS: Final = "sends no status, only other messages; requesting its hello until it does"


def _leapt(before_us: int, after_us: int) -> bool:
    """Whether the board's wrapped clock moved by more than a slow line explains."""
    half_us = CLOCK_WRAP_US // 2
    return abs((after_us - before_us + half_us) % CLOCK_WRAP_US - half_us) > LEAP_US


@dataclass(slots=True)
class PolledTimer:
    """Due once every `every_ns`. Instants are arguments."""

    every_ns: int
    t_last_ns: int = 0

    def restart(self, t_now_ns: int) -> None:
        """Count the period from now."""
        self.t_last_ns = t_now_ns

    def due(self, t_now_ns: int) -> bool:
        """Return whether the period has passed; then the next one starts."""
        if t_now_ns - self.t_last_ns < self.every_ns:
            return False
        self.t_last_ns = t_now_ns
        return True


class BoardSession:
    """One board, from one link-up to the next link-down."""

    def __init__(
        self,
        *,
        link_start_ns: int,
        controller: str,
        calibration: BoardCalibration = UNCALIBRATED,
        telemetry_hz: int = 0,
        fast_baud: int = 0,
    ) -> None:
        """`fast_baud` as in `LineSpeed`."""
        self.hello: BoardHello | None = None
        self.status: BoardStatus | None = None
        self.clock = BoardClock()
        self.latency = LinkLatency(link_start_ns)
        self.ledger = Ledger()
        self.reboots = 0
        self.lost_statuses = 0
        self.held_back = 0  # references and keep-alives not sent when they were due, since the board did not answer
        self.is_on_standby = False
        self.ended = ""  # why the last session ended
        self._is_leaving = False
        self._is_reporting = False  # a status has arrived since the handshake
        self.must_pulse = False  # with the next reference
        self.line = LineSpeed(fast_baud)
        self._settings = BoardSettings(controller, calibration, telemetry_hz)
        self._linked = False
        self._boot_id: int | None = None
        self._seq = 0
        self._t_numbered_ns = 0
        self.window = SendWindow()
        self._held: tuple[SafeDrive, Tick] | None = None
        self._t_received_ns = 0
        self._t_status_ns = 0
        self._t_timer_ns = 0
        self._t_stopped_ns = -COMPARABLE_AFTER_NS
        self._greeting = PolledTimer(GREET_EVERY_NS)
        self._asking_time = PolledTimer(SETTLE_TIME_EVERY_NS)
        self._keeping_alive = PolledTimer(KEEP_ALIVE_AFTER_NS)
        self._arming = PolledTimer(ARM_EVERY_NS)

    @property
    def ready(self) -> bool:
        """Whether references may be sent: the handshake lacks nothing."""
        return self._linked and not self.awaited

    @property
    def awaited(self) -> str:
        """The message that the handshake lacks, by its name in firmware/PROTOCOL.md; "" if it is complete."""
        if self.hello is None:
            return "HELLO"
        if self._settings.left:
            return "VERDICT"
        if not self.clock.ready:
            return "TIME"
        return "" if self._is_reporting else "STATUS"

    @property
    def setting(self) -> BoardSetting | None:
        """The setting that the board has not taken yet."""
        return self._settings.left[0] if self._settings.left else None

    @property
    def drive_hz(self) -> float:
        """The drive that the board was set to, from which it follows the plate; 0 before its hello."""
        return 0.0 if self.hello is None else self._settings.drive_hz(self.hello)

    @property
    def can_wait(self) -> bool:
        """Whether what the board sends may be read just before the next pass or timer: it is on standby or follows
        references, and no answer is awaited."""
        if self.is_on_standby or self.status is None:
            return self.is_on_standby and not self.clock.is_asked
        is_followed = self.status.state is BoardState.LIVE and self._held is None and self.setting is None
        return is_followed and not (self.clock.is_asked or self._is_leaving)

    def follows(self, t_now_ns: int) -> bool:
        """Whether the board follows references and has the last one, or may still acknowledge it."""
        if self.status is None or self.status.state is not BoardState.LIVE or self._held is not None:
            return False
        waited_ns = t_now_ns - self._t_numbered_ns
        return self.status.seq == self._seq or waited_ns < 2 * self.latency.link_ns + ANSWER_WITHIN_NS

    @property
    def awaits_last(self) -> bool:
        """Whether a board that follows references has yet to acknowledge the last one."""
        return self.status is not None and self.status.state is BoardState.LIVE and self.status.seq != self._seq

    def lacks_last(self, t_now_ns: int) -> bool:
        """Whether that acknowledgement did not come in time."""
        return self.awaits_last and self._held is None and not self.follows(t_now_ns)

    def holds(self, t_now_ns: int) -> bool:
        """Whether the board follows references, and need not get the last one again to go on with it."""
        return self.follows(t_now_ns) and t_now_ns - self._t_numbered_ns < RENEW_AFTER_NS

    def link_up(self, t_now_ns: int) -> list[BoardCommand]:
        """The port is open: start the handshake."""
        self.link_down()
        self._linked = True
        self._t_received_ns = self._t_timer_ns = t_now_ns
        self._greeting.restart(t_now_ns)
        return [HelloRequest()]

    def link_down(self) -> None:
        """The port is gone: drop all state of the board."""
        self._linked = self.is_on_standby = self._is_leaving = self._is_reporting = False
        self.hello = self.status = self._boot_id = None
        self.line.opened()
        self.must_pulse = False
        self.clock.reset()
        self.latency.reset()
        self._forget_sent()

    def receive_hello(self, hello: BoardHello, t_now_ns: int) -> list[BoardCommand]:
        """The board's accepted answer (its protocol and limits were checked): choose its controller, ask its time."""
        if self._boot_id not in (None, hello.boot_id):
            self.reboots += 1
            self.clock.reset()
            self._is_reporting = False
        self.is_on_standby = self._is_leaving and self._boot_id == hello.boot_id
        self._is_leaving = False
        self.hello, self._boot_id = hello, hello.boot_id
        self.status = None  # an earlier status does not hold for this session
        self._t_received_ns = self._t_status_ns = t_now_ns
        self._forget_sent()
        if self.is_on_standby:
            return []
        self._asking_time.restart(t_now_ns)
        fast_baud = self.line.offered(hello.baud_max)
        self._settings.begin(hello, fast_baud)
        if fast_baud > 0:
            return self._settings.send(t_now_ns)
        return [*self._settings.send(t_now_ns), TimeRequest(self.clock.request(t_now_ns))]

    def receive_answer(self, t_now_ns: int, *, is_taken: bool = True) -> list[BoardCommand]:
        """The board answered the last setting: send the next one. One that it refused is repeated by the timer, but for
        the line's speed, which then stays."""
        self._t_received_ns = t_now_ns
        if isinstance(self.setting, SetBaud):
            return self._change_baud(self.setting.baud if is_taken else 0, t_now_ns)
        if not is_taken:
            return []
        del self._settings.left[:1]
        return self._settings.send(t_now_ns)

    def _change_baud(self, baud: int, t_now_ns: int) -> list[BoardCommand]:
        """Begin the session again on a line of another speed; 0: of the first one, from now on."""
        self.line.change(baud, t_now_ns)
        self.hello = self.status = None
        self._is_leaving = self._is_reporting = False
        self._settings.left.clear()
        self._greeting.restart(t_now_ns)
        return [HelloRequest()]

    def receive_time(self, reply: BoardTime, t_now_ns: int) -> None:
        """Take a time reply; a stray one is ignored. A discontinuity means a reset behind an open port."""
        self._t_received_ns = t_now_ns
        was_known, relocks = self.clock.ready, self.clock.relocks
        if self.clock.update(reply, t_now_ns) and not self._is_mute(t_now_ns):
            self.window.read_until(min(reply.t_host_ns, t_now_ns - self._patience_ns), t_now_ns)
            self.window.answered()
        if self.clock.senseless >= SENSELESS_TIMES:
            self.clock.reset()
        elif self.clock.relocks == relocks:
            return
        if was_known:  # else the handshake waits for it
            self._start_over(DISCONTINUITY)

    def receive_status(self, status: BoardStatus, t_now_ns: int) -> LedgerLine | None:
        """Add the acknowledged frame to the ledger: link delay, and how late its first knot took effect. Return its
        line, None where there is none."""
        if self.hello is None:
            return None  # before the handshake no status counts
        self._t_received_ns = self._t_status_ns = t_now_ns
        was_stopped = t_now_ns - self._t_stopped_ns < COMPARABLE_AFTER_NS
        if self.status is not None and not was_stopped and _leapt(self.status.t_board_us, status.t_board_us):
            self._start_over(DISCONTINUITY)
            return None
        self.line.reported(status.bad_frames, is_first=self.status is None)
        if self.status is not None and self.status.number is not None and status.number is not None:
            self.lost_statuses += (status.number - self.status.number - 1) & 0xFFFF
        self.status = status
        self._is_reporting = True
        self.window.named(status.seq)
        self.window.answered()
        if self.clock.ready:  # a board that sends also reads: frames missing from the acknowledgement were lost
            t_status_ns = self.clock.to_host_ns(status.t_board_us, near=t_now_ns)
            self.window.read_until(t_status_ns - self._patience_ns, t_now_ns)
        flight = self.window.applied(status.seq) if status.applied and self.clock.ready else None
        return None if flight is None else self.ledger.applied(flight, status, self.clock, self.latency, t_now_ns)

    def reference(self, drive: SafeDrive, tick: Tick, t_now_ns: int) -> list[BoardCommand]:
        """Number a drive and convert it to the board's clock; nothing while the board is not ready. While it does not
        answer, the drive is held back and replaces the one before."""
        if not self.ready:
            return []
        if self._must_wait(t_now_ns):
            self.held_back += 1
            self._held = drive, tick
            return self._question(t_now_ns)
        is_overdue = self.window.is_overdue(t_now_ns, 2 * self.latency.link_ns)
        commands = self._numbered(drive, t_now_ns)
        self.window.follow(self._seq, Flight(t_now_ns, drive.t_apply_ns, tick))
        return [*commands, *self._question(t_now_ns)] if is_overdue else commands

    def resume(self, t_now_ns: int) -> list[BoardCommand]:
        """The board answered: send the reference that was held back, if it may go now and is not past."""
        if self._held is None or self._must_wait(t_now_ns):
            return []
        drive, tick = self._held
        return [] if t_now_ns - drive.t_apply_ns > protocol.STALE_NS else self.reference(drive, tick, t_now_ns)

    def timer(self, t_now_ns: int) -> list[BoardCommand]:
        """Return what is due: hello and time requests, keep-alives, and zero frames until the board is armed."""
        passed_ns, self._t_timer_ns = t_now_ns - self._t_timer_ns, t_now_ns
        if not self._linked:
            return []
        if passed_ns > STOPPED_AFTER_NS:
            self._t_received_ns = self._t_status_ns = self._t_stopped_ns = t_now_ns
        t_last_ns = self._t_status_ns if self._is_reporting else self._t_received_ns
        if self.hello is not None and t_now_ns - t_last_ns > SILENT_AFTER_NS:
            is_answering = t_now_ns - self._t_received_ns <= MUTE_AFTER_NS + self._patience_ns
            self._start_over(NO_STATUS if is_answering else SILENT)  # it hung or was replaced
        if self.line.fails(t_now_ns, is_greeted=self.hello is not None):
            self.ended = FAILED
            return self._change_baud(0, t_now_ns)
        if self.hello is None:
            return [HelloRequest()] if self._greeting.due(t_now_ns) else []
        commands = self._settings.repeat(t_now_ns)
        self._asking_time.every_ns = TIME_EVERY_NS if self.clock.ready else SETTLE_TIME_EVERY_NS
        if self._asking_time.due(t_now_ns):
            commands.append(TimeRequest(self.clock.request(t_now_ns)))
        if self.is_on_standby or not self.clock.ready or self.status is None or self.setting is not None:
            return commands
        if self.status.state is BoardState.TOOL:
            return commands  # a tool's sweep or voltage must end with the tool: no keep-alives from here
        is_full = self._must_wait(t_now_ns)
        if is_full or self.window.is_overdue(t_now_ns, 2 * self.latency.link_ns):
            commands += self._question(t_now_ns)
        if is_full:
            return commands
        if self.status.state is BoardState.QUIET and self._arming.due(t_now_ns):
            zero = silence(t_now_ns + self.latency.link_ns, self.hello.modes)
            commands += self._numbered(zero, t_now_ns)
        else:
            commands += self.keep_alive(t_now_ns)
        return commands

    def keep_alive(self, t_now_ns: int) -> list[BoardCommand]:
        """Return the keep-alive that is due for a board that `follows`, if any."""
        if not self._keeping_alive.due(t_now_ns):
            return []
        if self._is_mute(t_now_ns):
            self.held_back += 1
            return self._question(t_now_ns)
        return [Keepalive(self._seq)]

    def standby(self, t_now_ns: int) -> list[BoardCommand]:
        """Put a board that `follows` a zero frame on standby: it answers, and is quiet without a dead-man trip."""
        self._is_leaving = True
        self._keeping_alive.restart(t_now_ns)
        return [HelloRequest()]

    def wake(self, t_now_ns: int) -> list[BoardCommand]:
        """Arm a board on standby at once: it follows what comes next, ramping in over 10 ms."""
        if not self.is_on_standby or self.hello is None:
            return []
        self.is_on_standby = False
        self._t_status_ns = t_now_ns  # on standby what the board sends waits in the port
        zero = silence(t_now_ns + self.latency.link_ns, self.hello.modes)
        frames = [command for _ in range(protocol.REARM_FRAMES) for command in self._numbered(zero, t_now_ns)]
        return [*frames, *self._settings.telemetry]  # which the hello request has stopped

    @property
    def _patience_ns(self) -> int:
        """Longest time that the board may take to acknowledge a reference."""
        return 2 * self.latency.link_ns + OVERDUE_NS

    def _is_mute(self, t_now_ns: int) -> bool:
        """Whether the status is overdue: time replies alone do not show that references are followed."""
        return t_now_ns - self._t_status_ns > MUTE_AFTER_NS + self._patience_ns

    def _must_wait(self, t_now_ns: int) -> bool:
        """Whether another reference would only be queued, or followed without a report."""
        return self._is_mute(t_now_ns) or self.window.is_full(t_now_ns, self._patience_ns)

    def _question(self, t_now_ns: int) -> list[BoardCommand]:
        """Return a time request, which a board that reads answers at once, if one is due."""
        return [TimeRequest(self.clock.request(t_now_ns))] if self.window.may_ask(t_now_ns) else []

    def _forget_sent(self) -> None:
        """Drop all frames in flight."""
        self.window.clear()
        self._held = None

    def _start_over(self, reason: str) -> None:
        """Restart the handshake with the next timer: a board that was reset has lost controller and models."""
        self.ended = reason
        self.line.session_began(self._t_timer_ns)
        self.hello = self.status = None
        self.is_on_standby = self._is_leaving = self._is_reporting = False

    def _numbered(self, drive: SafeDrive, t_now_ns: int) -> list[BoardCommand]:
        self._seq = (self._seq + 1) & 0xFFFF
        self._t_numbered_ns = t_now_ns
        self._keeping_alive.restart(t_now_ns)
        self._arming.restart(t_now_ns)
        self.window.wrote(self._seq, t_now_ns)
        self._held = None
        has_pulse, self.must_pulse = self.must_pulse, False
        return [ReferenceFrame(self._seq, self.clock.to_board_us(drive.t_apply_ns), drive, has_pulse)]

"""What the board was sent and may not have taken yet: its settings, and references on their way.

A terminal buffers thousands of bytes for a board that has stopped reading. The board acknowledges each reference that
took effect, so one that is not acknowledged after a round trip was lost or is still unread. A time request decides: the
line keeps the order, so a board that answers it has read everything before it.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from ... import board_protocol as protocol
from ...board_protocol import SetBaud, SetDrive, SetTelemetry
from ...board_values import (
    BoardCalibration,
    BoardCommand,
    BoardHello,
    BoardSetting,
    SetController,
    SetModel,
    SetWiring,
)

REPEAT_EVERY_NS: Final = 100_000_000
SAME_DRIVE_HZ: Final = 0.01  # float32 resolves 0.002 Hz there
MOST_UNREAD: Final = 2  # references; more are only under way at once where a round trip takes longer than two reports
MOST_ON_A_BAD_LINE: Final = 4  # an acknowledgement may be lost there, and the board's dead-man timeout is 50 ms
BAD_FOR_NS: Final = 1_000_000_000  # since the last known loss
QUESTION_EVERY_NS: Final = 4_000_000
QUESTIONS: Final = 12  # at that rate; by then the board's dead-man has tripped
PATIENT_QUESTION_EVERY_NS: Final = 100_000_000


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


class BoardSettings:
    """The settings that the board has not taken yet, sent one at a time: an answer names only the kind of command."""

    def __init__(self, controller: str, calibration: BoardCalibration, telemetry_hz: int) -> None:
        self.telemetry: Final = [SetTelemetry(telemetry_hz)] if telemetry_hz > 0 else []
        self._controller: Final = controller
        self._calibration: Final = calibration
        self._left: deque[BoardSetting] = deque()
        self._repeating = PolledTimer(REPEAT_EVERY_NS)

    @property
    def next(self) -> BoardSetting | None:
        """The setting that is sent, and again until the board takes it."""
        return self._left[0] if self._left else None

    def drive_hz(self, hello: BoardHello) -> float:
        """Return the drive that the board is set to, from which it follows the plate."""
        return hello.drive_hz if self._calibration.drive_hz is None else self._calibration.drive_hz

    def begin(self, hello: BoardHello, baud: int) -> None:
        """List the settings of a board; a line's other speed alone, since all begins again on that."""
        if baud > 0:
            self._left = deque([SetBaud(baud)])
            return
        drive_hz = self.drive_hz(hello)
        moves = abs(drive_hz - hello.drive_hz) > SAME_DRIVE_HZ
        drive = [SetDrive(drive_hz, protocol.FOLLOW_HZ)] if moves else []
        models = [SetModel(measured.mode, measured.model(drive_hz)) for measured in self._calibration.modes]
        wiring = SetWiring.of(self._calibration, hello.modes)
        wires = [] if wiring is None else [wiring]
        self._left = deque([SetController(self._controller), *drive, *models, *wires, *self.telemetry])

    def clear(self) -> None:
        """Drop all: the session begins again."""
        self._left.clear()

    def taken(self) -> None:
        """Take note that the board took the first one."""
        if self._left:
            self._left.popleft()

    def send(self, t_now_ns: int) -> list[BoardCommand]:
        """Return the setting to send now, if any is left."""
        self._repeating.restart(t_now_ns)
        return [self._left[0]] if self._left else []

    def repeat(self, t_now_ns: int) -> list[BoardCommand]:
        """Return the setting that is due again, if any."""
        return [self._left[0]] if self._left and self._repeating.due(t_now_ns) else []


class SendWindow:
    """The references that the board may not have read yet, oldest first, and the requests sent after them."""

    def __init__(self) -> None:
        self._unread: deque[tuple[int, int]] = deque()
        self._questions = 0
        self._t_question_ns = 0
        self._t_lost_ns = -BAD_FOR_NS

    def clear(self) -> None:
        """Reset: the board was reset or replaced."""
        self._unread.clear()
        self._questions = 0

    def wrote(self, seq: int, t_now_ns: int) -> None:
        """Take note that reference `seq` was sent."""
        self._unread.append((seq, t_now_ns))

    def named(self, seq: int) -> None:
        """Take note that the board has this reference, and so has read all before it."""
        if any(seq == unread for unread, _ in self._unread):
            while self._unread.popleft()[0] != seq:
                pass

    def read_until(self, t_ns: int, t_now_ns: int) -> None:
        """Take note that the board has read all that was sent until `t_ns`. Frames missing from the acknowledgement
        were lost."""
        while self._unread and self._unread[0][1] <= t_ns:
            self._unread.popleft()
            self._t_lost_ns = t_now_ns

    def answered(self) -> None:
        """Take note that the board answered: requests start again at the fast rate."""
        self._questions = 0

    def is_overdue(self, t_now_ns: int, patience_ns: int) -> bool:
        """Whether the oldest was sent longer than `patience_ns` ago."""
        return len(self._unread) > 0 and t_now_ns - self._unread[0][1] > patience_ns

    def is_full(self, t_now_ns: int, patience_ns: int) -> bool:
        """Whether another reference would only be queued."""
        most = MOST_ON_A_BAD_LINE if t_now_ns - self._t_lost_ns < BAD_FOR_NS else MOST_UNREAD
        return len(self._unread) >= most and self.is_overdue(t_now_ns, patience_ns)

    def may_ask(self, t_now_ns: int) -> bool:
        """Return whether a request is due; it then counts as sent."""
        every_ns = QUESTION_EVERY_NS if self._questions < QUESTIONS else PATIENT_QUESTION_EVERY_NS
        if self._questions > 0 and t_now_ns - self._t_question_ns < every_ns:
            return False
        self._questions += 1
        self._t_question_ns = t_now_ns
        return True

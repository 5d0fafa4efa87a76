"""What a board is set to before it is driven: controller, drive, models in the drive's frame, wires, telemetry."""

from __future__ import annotations

from collections import deque
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
from .periodic_timer import PolledTimer

REPEAT_EVERY_NS: Final = 100_000_000
SAME_DRIVE_HZ: Final = 0.01  # float32 resolves 0.002 Hz there


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

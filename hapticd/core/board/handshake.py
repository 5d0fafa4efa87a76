"""Handshake of a session: the settings that the board takes one by one, and the speed of its line."""

from __future__ import annotations

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
GREETED_WITHIN_NS: Final = 600_000_000  # at the fast speed; the board returns to its first one after 1.2 s
NOISY_FRAMES: Final = 20  # damaged in one session: the line is too fast
FAILED: Final = "the fast line fails: it goes on at the speed of device.baud (check the cable)"


class BoardSettings:
    """The settings that the board has not taken yet, sent one at a time: an answer names only the kind of command."""

    def __init__(self, controller: str, calibration: BoardCalibration, telemetry_hz: int) -> None:
        self.telemetry: Final = [SetTelemetry(telemetry_hz)] if telemetry_hz > 0 else []
        self._controller: Final = controller
        self._calibration: Final = calibration
        self.left: list[BoardSetting] = []  # the first is sent, and again until the board takes it
        self._t_sent_ns = 0

    def drive_hz(self, hello: BoardHello) -> float:
        """Return the drive that the board is set to, from which it follows the plate."""
        return hello.drive_hz if self._calibration.drive_hz is None else self._calibration.drive_hz

    def begin(self, hello: BoardHello, baud: int) -> None:
        """List the settings of a board; a line's other speed alone, since all begins again on that."""
        if baud > 0:
            self.left = [SetBaud(baud)]
            return
        drive_hz = self.drive_hz(hello)
        moves = abs(drive_hz - hello.drive_hz) > SAME_DRIVE_HZ
        drive = [SetDrive(drive_hz, protocol.FOLLOW_HZ)] if moves else []
        models = [SetModel(measured.mode, measured.model(drive_hz)) for measured in self._calibration.modes]
        wiring = SetWiring.of(self._calibration, hello.modes)
        wires = [] if wiring is None else [wiring]
        self.left = [SetController(self._controller), *drive, *models, *wires, *self.telemetry]

    def send(self, t_now_ns: int) -> list[BoardCommand]:
        """Return the setting to send now, if any is left."""
        self._t_sent_ns = t_now_ns
        return [*self.left[:1]]

    def repeat(self, t_now_ns: int) -> list[BoardCommand]:
        """Return the setting that is due again, if any."""
        return self.send(t_now_ns) if t_now_ns - self._t_sent_ns >= REPEAT_EVERY_NS else []


class LineSpeed:
    """The speed of one line, from its opening on."""

    def __init__(self, fast_baud: int) -> None:
        """`fast_baud` is requested of a board that offers it; 0: the line keeps the speed that it was opened with."""
        self.baud = 0  # that the line should have; 0: the one that it was opened with
        self._fast_baud: Final = fast_baud
        self._has_failed = False
        self._t_began_ns = 0
        self._bad_frames = 0  # of the board, as the session began

    def opened(self) -> None:
        """Reset: the line was opened again."""
        self.baud, self._has_failed = 0, False

    def offered(self, baud_max: int) -> int:
        """Return the speed to request of a board that can follow `baud_max`; 0: none."""
        return 0 if self.baud or self._has_failed else min(self._fast_baud, baud_max)

    def change(self, baud: int, t_now_ns: int) -> None:
        """Take another speed; 0: the first one, from now on."""
        self.baud, self._has_failed = baud, baud == 0
        self._t_began_ns = t_now_ns

    def session_began(self, t_now_ns: int) -> None:
        """Take note that the board's hello is awaited from now on."""
        self._t_began_ns = t_now_ns

    def reported(self, bad_frames: int, *, is_first: bool) -> None:
        """Take note of how many frames reached the board damaged."""
        if is_first:
            self._bad_frames = bad_frames
        elif self.baud and bad_frames - self._bad_frames > NOISY_FRAMES:
            self._has_failed = True

    def fails(self, t_now_ns: int, *, is_greeted: bool) -> bool:
        """Whether a fast line damages frames, or the board does not answer on it."""
        is_silent = not is_greeted and t_now_ns - self._t_began_ns > GREETED_WITHIN_NS
        return self.baud > 0 and (self._has_failed or is_silent)

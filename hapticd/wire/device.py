"""The board's wire format by the names that others call, and the checks of its handshake."""

from __future__ import annotations

from collections.abc import Sequence

from .. import board_protocol as protocol
from ..board_values import BoardCalibration, BoardHello, is_within
from ..errors import DeviceError
from .board_messages import BoardDecoder
from .commands import ALL_COMMANDS
from .commands import encode as encode
from .commands import encode_reference as encode_reference

Decoder = BoardDecoder
FLASH = "flash the firmware that came with this hapticd"


def check_protocol(hello: BoardHello, remedy: str = FLASH) -> None:
    """Raise DeviceError if the board has another protocol version, or another hash without knowing every command."""
    if hello.protocol_version != protocol.PROTOCOL_VERSION:
        raise DeviceError(
            f"The board has protocol version {hello.protocol_version}, this hapticd {protocol.PROTOCOL_VERSION}: "
            f"{remedy}."
        )
    if hello.protocol_hash != protocol.PROTOCOL_HASH and hello.commands & ALL_COMMANDS != ALL_COMMANDS:
        raise DeviceError(
            f"The board has protocol hash {hello.protocol_hash:08x}, this hapticd {protocol.PROTOCOL_HASH:08x}: "
            f"{remedy}."
        )


def check_hello(hello: BoardHello, *, modes: int, w_limit_um: Sequence[float], remedy: str = FLASH) -> None:
    """Raise DeviceError if this board must not be driven with these settings; `remedy` is of another firmware.

    A board may allow more than the settings: each side applies its own limit.
    """
    check_protocol(hello, remedy)
    for name, bounds in protocol.HELLO_BOUNDS.items():
        value = getattr(hello, name)
        if not is_within(value, bounds):
            raise DeviceError(
                f"The board's HELLO makes no sense: {name} is {value:g}, not within {bounds[0]:g}..{bounds[1]:g}: "
                f"{remedy}."
            )
    if hello.modes != modes:
        raise DeviceError(
            f"The board drives {hello.modes} modes, the mode map has {modes}: use a matching map and firmware."
        )
    for k, (allowed_um, requested_um) in enumerate(zip(hello.w_limit_um, w_limit_um, strict=True)):
        if not requested_um <= allowed_um * (1.0 + 1e-6):
            raise DeviceError(
                f"The limit of mode {k} is set to {requested_um:g} um but the board allows {allowed_um:g} um: "
                f"set it to {allowed_um:g} or less."
            )


def check_calibration(hello: BoardHello, calibration: BoardCalibration) -> None:
    """Raise DeviceError if the drive to be set, or a mode, is too far away for the board."""
    drive_hz = hello.drive_hz if calibration.drive_hz is None else calibration.drive_hz
    if not abs(drive_hz - hello.drive_hz) <= protocol.DRIVE_MOVE_MAX_HZ:
        raise DeviceError(
            f"The calibration file sets the drive to {drive_hz:g} Hz but the board's is {hello.drive_hz:g} Hz, and it "
            f"moves {protocol.DRIVE_MOVE_MAX_HZ:g} Hz at most: set DRIVE_HZ in the firmware, or drive_hz in the file."
        )
    for measured in calibration.modes:
        if not abs(measured.model(drive_hz).detuning_rad_s) <= protocol.DETUNING_MAX_RAD_S:
            raise DeviceError(
                f"Mode {measured.mode} is calibrated at {measured.frequency_hz:g} Hz but the board drives at "
                f"{drive_hz:g} Hz: measure it again with `hapticd calibrate resonance`."
            )

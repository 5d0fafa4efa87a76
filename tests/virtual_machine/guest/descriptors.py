"""What the virtual pads declare.

A real pad declares a mouse (report 0x02) and vendor reports, and not the touch reports it sends: on Bluetooth these
are known to the kernel's driver alone. Its descriptors themselves are Apple's and not here; the drivers look at ids,
collection and interface, which are the same.
"""

from __future__ import annotations

_BUTTONS_AND_XY = bytes.fromhex(
    "05 09 19 01 29 02 15 00 25 01 95 02 75 01 81 02 95 01 75 06 81 03"  # two buttons and padding
    "05 01 09 30 09 31 15 81 25 7f 75 08 95 02 81 06"  # x and y, relative
)


def _mouse(more: bytes) -> bytes:
    return bytes.fromhex("05 01 09 02 a1 01 85 02 09 01 a1 00") + _BUTTONS_AND_XY + b"\xc0" + more + b"\xc0"


MOUSE = _mouse(b"")
# On USB the touch frames come in the mouse's own report, and the enable is a feature report of the same number.
MAX_REPORT_BYTES = 12 + 15 * 9
MOUSE_AND_FRAMES = _mouse(
    bytes.fromhex("06 00 ff 09 14 15 00 26 ff 00 75 08 95") + bytes((MAX_REPORT_BYTES - 4,)) + bytes.fromhex("81 02")
    + bytes.fromhex("09 15 95 01 b1 02")
)  # fmt: skip
VENDOR = bytes.fromhex("06 00 ff 09 0b a1 01 85 e0 09 0b 15 00 26 ff 00 75 08 95 04 81 02 c0")

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


def touchscreen(contacts: int) -> bytes:
    """A touchscreen as HID has them: report 1 holds each finger's tip, number, x and y, then how many there are.

    344.0 x 194.0 mm in tenths of a millimetre, which is the unit of the physical range (cm, exponent -2).
    """
    item = bytes.fromhex
    finger = (
        item("09 22 a1 02")  # a finger
        + item("09 42 15 00 25 01 75 01 95 01 81 02 95 07 81 03")  # its tip switch, and padding
        + item("75 08 95 01 09 51 26 ff 00 81 02")  # its number
        + item("05 01 75 10 55 0e 65 11 09 30 35 00 46 70 0d 26 70 0d 81 02")  # x
        + item("09 31 46 94 07 26 94 07 81 02 05 0d 45 00 55 00 65 00 c0")  # y
    )
    count = item("09 54 25 7f 75 08 95 01 81 02") + item("85 02 09 55 25") + bytes((contacts,)) + item("b1 02")
    return item("05 0d 09 04 a1 01 85 01") + finger * contacts + count + b"\xc0"

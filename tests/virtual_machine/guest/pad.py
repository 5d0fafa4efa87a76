"""A Magic Trackpad 2 on Bluetooth, made by /dev/uhid: to the kernel's drivers one behind a real link; and fingers.

What it leaves out: the link itself (HIDP, BlueZ), and with it pairing, delays and lost packets. A real pad declares a
mouse and not the touch reports that it sends; its descriptor is Apple's and not here, but the drivers look at ids,
collection and interface, which are the same. Layouts: the kernel's `include/uapi/linux/uhid.h`.
"""

from __future__ import annotations

import os
import struct
import threading
import time
from collections.abc import Callable

from hapticd.sim.fingers.sensor import PadRecord, encode_mt2

UHID_DESTROY, UHID_STOP, UHID_GET_REPORT, UHID_GET_REPORT_REPLY = 1, 3, 9, 10
UHID_CREATE2, UHID_INPUT2, UHID_SET_REPORT, UHID_SET_REPORT_REPLY = 11, 12, 13, 14
CREATE2 = struct.Struct("<I128s64s64sHHIIII4096s")
INPUT2 = struct.Struct("<IH4096s")
REQUEST = struct.Struct("<IIBBH")  # of SET_REPORT: type, id, report number, report type, size
EVENT_BYTES = 4380
EIO = 5
BUS_BLUETOOTH, VENDOR_ID, PRODUCT_ID, VERSION = 5, 0x004C, 0x0265, 0x110
HID_ID = f"{BUS_BLUETOOTH:04X}:{VENDOR_ID:04X}:{PRODUCT_ID:04X}"
NAMES = b"virtual trackpad", b"tests/virtual_machine", b"5c:c0:ff:ee:00:01"
MOUSE = bytes.fromhex(
    "05 01 09 02 a1 01 85 02 09 01 a1 00"
    "05 09 19 01 29 02 15 00 25 01 95 02 75 01 81 02 95 01 75 06 81 03"  # two buttons and padding
    "05 01 09 30 09 31 15 81 25 7f 75 08 95 02 81 06 c0 c0"  # x and y, relative
)


class BluetoothPad:
    """Connected from the construction to `unplug`. `features` are the feature reports it was given, oldest first."""

    def __init__(self) -> None:
        self.features: list[bytes] = []
        self._fd = os.open("/dev/uhid", os.O_RDWR)
        self._thread = threading.Thread(target=self._answer, daemon=True)
        ids = BUS_BLUETOOTH, VENDOR_ID, PRODUCT_ID, VERSION, 0
        os.write(self._fd, CREATE2.pack(UHID_CREATE2, *NAMES, len(MOUSE), *ids, MOUSE))
        self._thread.start()

    def touch(self, places: dict[int, tuple[int, int]]) -> None:
        """A frame of fingers at raw positions, by contact id."""
        records = [PadRecord(contact_id, x, y) for contact_id, (x, y) in places.items()]
        report = encode_mt2(time.monotonic_ns() // 1_000_000, records, usb=False)
        os.write(self._fd, INPUT2.pack(UHID_INPUT2, len(report), report))

    def unplug(self) -> None:
        os.write(self._fd, struct.pack("<I", UHID_DESTROY))
        self._thread.join()
        os.close(self._fd)

    def _answer(self) -> None:
        """Take every feature and refuse to tell any (the kernel asks for the battery); STOP comes with the end."""
        while True:
            event = os.read(self._fd, EVENT_BYTES)
            kind = struct.unpack_from("<I", event)[0]
            if kind == UHID_STOP:
                return
            if kind == UHID_SET_REPORT:
                _, request, _, _, size = REQUEST.unpack_from(event)
                self.features.append(event[REQUEST.size : REQUEST.size + size])
                os.write(self._fd, struct.pack("<IIH", UHID_SET_REPORT_REPLY, request, 0))
            elif kind == UHID_GET_REPORT:
                request = struct.unpack_from("<I", event, 4)[0]
                os.write(self._fd, struct.pack("<IIHH4096s", UHID_GET_REPORT_REPLY, request, EIO, 0, b""))


class RestingFingers:
    """Calls `report` at a pad's pace with the frame's number, from the construction to `freeze`."""

    PERIOD_S = 0.01125

    def __init__(self, report: Callable[[int], None]) -> None:
        self._report = report
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._rest, daemon=True)
        self._thread.start()

    def freeze(self) -> None:
        """No more frames; the device's last word is that the fingers are down."""
        self._ended.set()
        self._thread.join()

    def _rest(self) -> None:
        frame = 0
        while not self._ended.wait(self.PERIOD_S):
            self._report(frame)
            frame += 1

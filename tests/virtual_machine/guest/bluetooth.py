"""A trackpad on Bluetooth, or another HID device, made by /dev/uhid: to the kernel's drivers one behind a real link.

What it leaves out: the link itself (HIDP, BlueZ), and with it pairing, delays and lost packets. Layouts: the kernel's
`include/uapi/linux/uhid.h`.
"""

from __future__ import annotations

import os
import struct
import threading

from descriptors import MOUSE

UHID_DESTROY, UHID_STOP, UHID_GET_REPORT, UHID_GET_REPORT_REPLY = 1, 3, 9, 10
UHID_CREATE2, UHID_INPUT2, UHID_SET_REPORT, UHID_SET_REPORT_REPLY = 11, 12, 13, 14
CREATE2 = struct.Struct("<I128s64s64sHHIIII4096s")
INPUT2 = struct.Struct("<IH4096s")
REQUEST = struct.Struct("<IIBBH")  # of SET_REPORT: type, id, report number, report type, size
SET_REPLY = struct.Struct("<IIH")
GET_REPLY = struct.Struct("<IIHH4096s")
EVENT_BYTES = 4380
BUS_USB, BUS_BLUETOOTH = 3, 5
EIO = 5
UNIQUE = "5c:c0:ff:ee:00:01"


class BluetoothPad:
    """Connected from the construction to `unplug`. `features` are the feature reports it was given, oldest first."""

    def __init__(
        self, vendor_id: int, product_id: int, descriptor: bytes = MOUSE, bus: int = BUS_BLUETOOTH,
        name: str = "virtual trackpad",
    ) -> None:  # fmt: skip
        self.features: list[bytes] = []
        self._fd = os.open("/dev/uhid", os.O_RDWR)
        self._thread = threading.Thread(target=self._answer, daemon=True)
        names = name.encode(), b"tests/virtual_machine", UNIQUE.encode()
        ids = bus, vendor_id, product_id, 0x110, 0
        os.write(self._fd, CREATE2.pack(UHID_CREATE2, *names, len(descriptor), *ids, descriptor))
        self._thread.start()

    def send(self, report: bytes) -> None:
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
                os.write(self._fd, SET_REPLY.pack(UHID_SET_REPORT_REPLY, request, 0))
            elif kind == UHID_GET_REPORT:
                request = struct.unpack_from("<I", event, 4)[0]
                os.write(self._fd, GET_REPLY.pack(UHID_GET_REPORT_REPLY, request, EIO, 0, b""))

"""A trackpad on USB, or a board: a gadget on a bus in memory (dummy_hcd), plugged in by binding it.

The host's whole USB stack takes part: enumeration, usbhid, interface numbers, control transfers. What it leaves out:
the wire, and the pad's own descriptors, so also how a real endpoint may cut frames of many fingers into packets. Files:
the kernel's `Documentation/usb/gadget_configfs.rst`.
"""

from __future__ import annotations

import os
import select
from pathlib import Path

from descriptors import MAX_REPORT_BYTES, MOUSE_AND_FRAMES, VENDOR
from kernel import wait_for

GADGET = Path("/sys/kernel/config/usb_gadget/trackpad")
BOARD = GADGET.with_name("board")
TOUCH = Path("/dev/hidg1")


class CablePad:
    """The gadget is made once; `plug` and `unplug` are the cable. `features` are the reports it was given."""

    def __init__(self, vendor_id: int, product_id: int) -> None:
        self.features: list[bytes] = []
        _device(GADGET, vendor_id, product_id)
        _function(0, VENDOR, protocol=0, report_bytes=64)
        _function(1, MOUSE_AND_FRAMES, protocol=2, report_bytes=MAX_REPORT_BYTES)  # 2: a mouse

    def plug(self) -> None:
        _bind(GADGET)
        wait_for(str(TOUCH), TOUCH.exists)
        self._fd = os.open(TOUCH, os.O_RDWR | os.O_NONBLOCK)

    def unplug(self) -> None:
        os.close(self._fd)
        _write(GADGET, UDC="")

    def send(self, report: bytes) -> None:
        """TimeoutError or OSError if the host does not fetch it."""
        if not select.select([], [self._fd], [], 5.0)[1]:
            raise TimeoutError("the host does not poll the endpoint")
        os.write(self._fd, report)

    def collect(self) -> list[bytes]:
        """`features`, with those that came since the last call."""
        while select.select([self._fd], [], [], 0)[0]:
            self.features.append(os.read(self._fd, 4096))
        return self.features


class CableBoard:
    """A serial port with a board's ids and nothing behind it; plugged from the construction to `unplug`."""

    def __init__(self, vendor_id: int, product_id: int) -> None:
        _device(BOARD, vendor_id, product_id)
        (BOARD / "functions/acm.0").mkdir(parents=True)
        (BOARD / "configs/c.1/acm.0").symlink_to(BOARD / "functions/acm.0")
        _bind(BOARD)

    def unplug(self) -> None:
        _write(BOARD, UDC="")


def _device(gadget: Path, vendor_id: int, product_id: int) -> None:
    _write(gadget, idVendor=f"{vendor_id:#06x}", idProduct=f"{product_id:#06x}", bcdDevice="0x0110")
    _write(gadget / "strings/0x409", manufacturer="tests", product=f"virtual {gadget.name}", serialnumber="1")
    _write(gadget / "configs/c.1", MaxPower="500")


def _bind(gadget: Path) -> None:
    _write(gadget, UDC=os.listdir("/sys/class/udc")[0])


def _function(number: int, descriptor: bytes, *, protocol: int, report_bytes: int) -> None:
    function = GADGET / f"functions/hid.{number}"
    subclass = 1 if protocol == 2 else 0
    _write(function, protocol=protocol, subclass=subclass, report_length=report_bytes, no_out_endpoint=1)
    (function / "report_desc").write_bytes(descriptor)
    (GADGET / f"configs/c.1/hid.{number}").symlink_to(function)


def _write(folder: Path, **values: str | int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, value in values.items():
        (folder / name).write_text(f"{value}\n")

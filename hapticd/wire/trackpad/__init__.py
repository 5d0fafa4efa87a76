"""Reports of touch devices to TouchFrames: bytes in, values out, no I/O.

Apple's layouts, ranges and the meaning of states are those of the Linux driver `drivers/hid/hid-magicmouse.c`: report
0x02 (Magic Trackpad 2 and USB-C over USB), 0x31 (the same over Bluetooth) and 0x28, alone or two in a 0xF7 (Magic
Trackpad 1). `tests/data/trackpad-golden.jsonl` holds that driver's own output for 121 reports. Other devices come as
the kernel's input events (`evdev`), or as datagrams of a tracker (`tuio`).
"""

from . import evdev, tuio
from .magic_trackpad_2 import STAMP_WRAP_MS
from .pad import MAX_RECORDS, RECORD, HidIds, Pad, PadGeometry
from .pads import DEFAULT_PAD, PADS, Decoder, from_fields, to_fields
from .still_contacts import StillContacts

__all__ = [
    "DEFAULT_PAD",
    "MAX_RECORDS",
    "PADS",
    "RECORD",
    "STAMP_WRAP_MS",
    "Decoder",
    "HidIds",
    "Pad",
    "PadGeometry",
    "StillContacts",
    "evdev",
    "from_fields",
    "to_fields",
    "tuio",
]

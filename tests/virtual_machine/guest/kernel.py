"""What the kernel says of devices, and waits for what it, or anything else, brings about."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

PATIENCE_S = 90.0  # for an emulated machine that others keep waiting
Found = TypeVar("Found")


def wait_for(what: str, look: Callable[[], Found | None], every_s: float = 0.01) -> Found:
    """Poll until there is something; TimeoutError names what never came."""
    t_end_s = time.monotonic() + PATIENCE_S
    while not (found := look()):
        if time.monotonic() > t_end_s:
            raise TimeoutError(f"{what} did not come about in {PATIENCE_S:.0f} s")
        time.sleep(every_s)
    return found


def hidraw_of(hid_id: str) -> Path:
    """The hidraw node of the device with these ids (such as 0005:004C:0265), once it is there and has a driver."""

    def look() -> Path | None:
        for entry in Path("/sys/class/hidraw").iterdir():
            device = (entry / "device").resolve()
            if device.name.startswith(hid_id) and (device / "driver").exists():
                return Path("/dev") / entry.name
        return None

    return wait_for(f"a hidraw node of {hid_id}", look)

"""A compass rose to be read without looking: a slippery ring with eight notches; the one that points north is wide."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence

from hapticd_client import Circle, Client, HapticdError, Rectangle

NAMES = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")  # anticlockwise from +x
INNER_MM, OUTER_MM, EIGHTH_RAD = 25.0, 55.0, math.pi / 4


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, epilog="example: hapticd run --sim &  python compass.py")
    parser.add_argument("--notch-mm", type=float, default=4.0, help="width of a notch (%(default)s mm)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            lay(plate, options.notch_mm)
            serve(plate, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def lay(plate: Client, notch_mm: float) -> None:
    """Lay the ring, its hub, and the notches on top."""
    plate.surface("ring", Circle(OUTER_MM), friction=0.05)
    plate.surface("hub", Circle(INNER_MM), friction=1.0, z=1)
    for turn, name in enumerate(NAMES):
        angle_rad, middle_mm = turn * EIGHTH_RAD, (INNER_MM + OUTER_MM) / 2
        notch = Rectangle(OUTER_MM - INNER_MM, notch_mm * (3 if name == "N" else 1))
        place_mm = (middle_mm * math.cos(angle_rad), middle_mm * math.sin(angle_rad))
        plate.surface(name, notch, friction=1.0, position_mm=place_mm, angle_rad=angle_rad, z=2)


def serve(plate: Client, end_s: float) -> None:
    """Print the direction of each finger on the ring whenever it changes."""
    print("Follow the ring: which way is north?", flush=True)
    pointed: dict[int | str, str] = {}
    for state in plate.states():
        for finger in state.fingers:
            bearing = NAMES[round(math.atan2(finger.y_mm, finger.x_mm) / EIGHTH_RAD) % 8]
            if INNER_MM < math.hypot(finger.x_mm, finger.y_mm) < OUTER_MM and pointed.get(finger.id) != bearing:
                pointed[finger.id] = bearing
                print(f"finger {finger.id}: {bearing}", flush=True)
        if time.monotonic() > end_s:
            break


if __name__ == "__main__":
    main()

"""The paper's study: a virtual finger moves along a line while the user explores the plate.

The user's fingers slip and the virtual finger sticks; --swap exchanges the two.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError

SLIPPERY, STICKY = 0.49, 1.0  # friction, 0 .. 1


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python virtual_finger.py --swap --speed 80",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--swap", action="store_true", help="the user's fingers stick, the virtual one slips")
    parser.add_argument("--speed", type=float, default=50.0, help="speed of the virtual finger (%(default)s mm/s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)
    user, virtual = (STICKY, SLIPPERY) if options.swap else (SLIPPERY, STICKY)

    try:
        with Client(options.endpoint) as plate:
            plate.virtual("walker", path=[(-40, 20), (40, 20)], speed_mm_s=options.speed)
            plate.set("walker", friction=virtual)
            serve(plate, user, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def serve(plate: Client, friction: float, end_s: float) -> None:
    """Give every finger of the user the same friction."""
    landed = set()
    for state in plate.states():
        for finger in state.fingers:
            if not finger.virtual and (state.instance, finger.id) not in landed:
                landed.add((state.instance, finger.id))
                plate.set(finger, friction=friction)
                print(f"finger {finger.id}: friction {friction:g}")
        if time.monotonic() > end_s:
            break


if __name__ == "__main__":
    main()

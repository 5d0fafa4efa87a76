"""Give each finger half of what it can have: between the lowest and the highest friction in its reach.

On a plate of four modes or more; touch it with two fingers.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, FingerState, HapticdError, RefusedError


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: hapticd run --sim --plate fingertip &  python reach.py"
    )
    parser.add_argument("--every", type=float, default=0.5, help="seconds between requests (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            end_s = time.monotonic() + options.seconds
            while time.monotonic() < end_s:
                for finger in plate.fingers():
                    print(halved(plate, finger), flush=True)
                time.sleep(options.every)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def halved(plate: Client, finger: FingerState) -> str:
    """Set a finger to the middle of its reach."""
    try:
        reach = plate.reach(finger)
    except RefusedError as error:  # it has lifted, or the plate is driven for points
        return f"finger {finger.id}: {error}"
    if reach is None:
        return f"finger {finger.id}: out of reach beside the others"
    low, high = reach
    middle = (low + high) / 2
    plate.set(finger, friction=middle)
    return f"finger {finger.id}: friction {low:.2f} .. {high:.2f}, set to {middle:.2f}"


if __name__ == "__main__":
    main()

"""The paper's environment on both halves of the plate: left fingers slip, right ones stick on still glass.

A finger keeps the target of the side where it landed, so that two fingers may cross.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, RefusedError


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python paper_environment.py --friction 0.05",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--friction", type=float, default=0.49, help="on the left, 0 (slippery) .. 1 (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            serve(plate, options.friction, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def serve(plate: Client, slippery: float, end_s: float) -> None:
    """Give each finger that lands the friction of its side."""
    landed = set()
    for state in plate.states():
        for finger in state.fingers:
            if finger.virtual or (state.instance, finger.id) in landed:
                continue
            landed.add((state.instance, finger.id))
            friction = slippery if finger.x_mm < 0 else 1.0
            try:
                plate.set(finger, friction=friction)
                print(f"finger {finger.id} landed at x = {finger.x_mm:+.1f} mm: friction {friction:g}")
            except RefusedError as refusal:
                print(refusal)
        if time.monotonic() > end_s:
            break


if __name__ == "__main__":
    main()

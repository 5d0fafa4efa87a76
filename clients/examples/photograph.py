"""A tactile picture: slippery where it is bright, sticky where it is dark.

Without a picture file it shows a ball lit from the upper left.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path

from hapticd_client import Client, FingerState, HapticdError, Map

SIDE = 64  # pixels of the ball's picture


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python photograph.py portrait.jpg --friction 0.2",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("picture", nargs="?", type=Path, help="any file that Pillow reads; its middle square is used")
    parser.add_argument("--friction", type=float, default=0.05, help="of white, 0 (most slippery) .. 1 (%(default)s)")
    parser.add_argument("--negative", action="store_true", help="make dark parts slippery")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        frictions = (options.friction, 1.0) if options.negative else (1.0, options.friction)  # of black and of white
        if options.picture is None:
            picture = Map(ball(), frictions=frictions)
        else:
            picture = Map.from_image(options.picture, frictions=frictions)
        with Client(options.endpoint) as plate:
            serve(plate, picture, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def ball() -> list[list[int]]:
    """Return grey levels of a matt ball: the cosine between surface normal and light."""
    middle, radius = (SIDE - 1) / 2, 0.45 * SIDE
    levels = []
    for row in range(SIDE):
        for column in range(SIDE):
            right, up = (column - middle) / radius, (middle - row) / radius
            front = math.sqrt(max(1 - right**2 - up**2, 0.0))
            light = (front + up - right) / math.sqrt(3) if front > 0 else 0.0
            levels.append(round(255 * max(light, 0.0)))
    return [levels[start : start + SIDE] for start in range(0, SIDE * SIDE, SIDE)]


def serve(plate: Client, picture: Map, end_s: float) -> None:
    """Give every finger that lands the picture, and print positions and what they feel."""
    landed = set()
    next_line_s = time.monotonic()
    for state in plate.states():
        now_s = time.monotonic()
        for finger in state.fingers:
            if not finger.virtual and (state.instance, finger.id) not in landed:
                landed.add((state.instance, finger.id))
                plate.set(finger, map=picture)
                print(f"finger {finger.id} feels the picture")
        felt = [finger for finger in state.fingers if finger.felt_friction is not None]
        if felt and now_s >= next_line_s:
            next_line_s = now_s + 0.5
            print("   ".join(map(line, felt)))
        if now_s > end_s:
            break


def line(finger: FingerState) -> str:
    """Format where a finger is and what it feels."""
    return f"{finger.id}: x {finger.x_mm:+5.1f}, y {finger.y_mm:+5.1f}, friction {finger.felt_friction:.2f}"


if __name__ == "__main__":
    main()

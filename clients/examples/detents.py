"""A slider with detents: along its track a finger slips between sticky detents.

Outside the track the glass is bare, so that its edges can be felt.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, Map

PLATE_MM = 137.5
PIXELS = 128  # 1.07 mm each
TRACK_MM = 100.0  # between the outermost detents
HALF_WIDTH_MM = 12.0
DETENT_MM = 3.0  # width of a detent


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python detents.py --detents 5",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--detents", type=int, default=9, choices=range(2, 21), metavar="2..20", help="(%(default)s)")
    parser.add_argument("--friction", type=float, default=0.05, help="between detents, 0 .. 1 (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        slider = slider_map(options.detents, options.friction)
        with Client(options.endpoint) as plate:
            serve(plate, slider, options.detents, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def slider_map(detents: int, friction: float) -> Map:
    """Return the track as frictions: slippery except at the detents, bare glass outside."""
    track = [255 * is_slippery(x_mm, detents) for x_mm in middles_mm()]
    bare = [0] * PIXELS
    rows = [track if abs(y_mm) <= HALF_WIDTH_MM else bare for y_mm in middles_mm()]
    return Map(rows, frictions=(1.0, friction))


def middles_mm() -> list[float]:
    """Return the centres of the pixels from -x to +x; the same along y, as the track is symmetric."""
    return [((pixel + 0.5) / PIXELS - 0.5) * PLATE_MM for pixel in range(PIXELS)]


def is_slippery(x_mm: float, detents: int) -> bool:
    """Return whether the position lies between two detents."""
    pitch_mm = TRACK_MM / (detents - 1)
    from_detent_mm = abs(x_mm - (-TRACK_MM / 2 + nearest(x_mm, detents) * pitch_mm))
    return DETENT_MM / 2 < from_detent_mm <= pitch_mm / 2


def nearest(x_mm: float, detents: int) -> int:
    """Return the index of the nearest detent, 0 at the left."""
    return min(max(round((x_mm / TRACK_MM + 0.5) * (detents - 1)), 0), detents - 1)


def serve(plate: Client, slider: Map, detents: int, end_s: float) -> None:
    """Give every finger that lands the slider, and print each detent that it reaches."""
    at: dict[tuple[int, int | str], int] = {}
    for state in plate.states():
        for finger in state.fingers:
            if finger.virtual:
                continue
            key = state.instance, finger.id
            if key not in at:
                plate.set(finger, map=slider)
            detent = nearest(finger.x_mm, detents)
            if key not in at or (at[key] != detent and abs(finger.y_mm) <= HALF_WIDTH_MM):
                at[key] = detent
                print(f"finger {finger.id}: detent {detent}")
        if time.monotonic() > end_s:
            break


if __name__ == "__main__":
    main()

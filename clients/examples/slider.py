"""A slider on the plate: a slippery track with sticky detents, felt by every finger from its first touch on."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, Rectangle

TRACK_MM, HEIGHT_MM, DETENT_MM = 100.0, 24.0, 3.0


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: hapticd run --sim &  python slider.py --detents 5"
    )
    parser.add_argument("--detents", type=int, default=7, choices=range(2, 16), metavar="2..15", help="(%(default)s)")
    parser.add_argument(
        "--friction", type=float, default=0.05, help="between detents, 0 (most slippery) .. 1 (%(default)s)"
    )
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            lay(plate, options.detents, options.friction)
            print(f"{options.detents} detents on a track of {TRACK_MM:g} mm: stroke along it", flush=True)
            time.sleep(min(options.seconds, 1e6))
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def lay(plate: Client, detents: int, friction: float) -> None:
    """Lay the track, and the detents on top of it."""
    plate.surface("track", Rectangle(TRACK_MM + DETENT_MM, HEIGHT_MM), friction=friction)
    for detent in range(detents):
        x_mm = TRACK_MM * (detent / (detents - 1) - 0.5)
        plate.surface(f"detent {detent}", Rectangle(DETENT_MM, HEIGHT_MM), friction=1.0, position_mm=(x_mm, 0), z=1)


if __name__ == "__main__":
    main()

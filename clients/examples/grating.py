"""A grating: every finger feels alternating slippery and sticky stripes."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence

from hapticd_client import Client, Grating, HapticdError


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: hapticd run --sim &  python grating.py --period-mm 4 --angle-deg 45"
    )
    parser.add_argument("--period-mm", type=float, default=8.0, help="period of the stripes (%(default)s mm)")
    parser.add_argument("--high-um", type=float, default=1.5, help="amplitude of a slippery stripe (%(default)s um)")
    parser.add_argument("--angle-deg", type=float, default=0.0, help="0: across x; anticlockwise (%(default)s)")
    parser.add_argument("--duty", type=float, default=0.0, help="slippery share of a square wave; 0: a sine")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)
    grating = Grating(options.period_mm, options.high_um, 0.0, math.radians(options.angle_deg), options.duty)

    try:
        with Client(options.endpoint) as plate:
            serve(plate, grating, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def serve(plate: Client, grating: Grating, end_s: float) -> None:
    """Give every finger that lands the grating."""
    landed = set()
    for state in plate.states():
        for finger in state.fingers:
            if not finger.virtual and (state.instance, finger.id) not in landed:
                landed.add((state.instance, finger.id))
                plate.set(finger, grating=grating)
                print(f"finger {finger.id}: stripes every {grating.period_mm:g} mm, 0 .. {grating.high_um:g} um")
        if time.monotonic() > end_s:
            break


if __name__ == "__main__":
    main()

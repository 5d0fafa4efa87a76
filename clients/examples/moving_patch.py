"""A slippery patch that moves back and forth over sticky glass, under any finger; two fingers on it hold it."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence

from hapticd_client import Circle, Client, HapticdError, PlateState

REACH_MM = 40.0  # from the centre, where it turns


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: hapticd run --sim &  python moving_patch.py --speed 60"
    )
    parser.add_argument("--speed", type=float, default=40.0, help="speed of the patch (%(default)s mm/s)")
    parser.add_argument("--radius-mm", type=float, default=15.0, help="radius of the patch (%(default)s mm)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            serve(plate, options.radius_mm, options.speed, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def serve(plate: Client, radius_mm: float, speed_mm_s: float, end_s: float) -> None:
    """Set the patch in motion, turn it at either end, and stop it while two fingers are on it."""
    x_mm, t_ns, velocity_mm_s, direction = -REACH_MM, None, math.nan, 1.0
    for state in plate.states():
        x_mm += 0.0 if t_ns is None else velocity_mm_s * (state.t_ns - t_ns) * 1e-9
        t_ns = state.t_ns
        if abs(x_mm) >= REACH_MM:
            direction = -math.copysign(1.0, x_mm)
        wanted_mm_s = 0.0 if fingers_on(state, x_mm, radius_mm) >= 2 else direction * speed_mm_s
        if wanted_mm_s != velocity_mm_s:
            velocity_mm_s = wanted_mm_s
            pose = {"position_mm": (x_mm, 0.0), "velocity_mm_s": (velocity_mm_s, 0.0), "t_pose_ns": t_ns}
            plate.surface("patch", Circle(radius_mm), friction=0.05, wait=False, **pose)
            print(f"patch at x = {x_mm:+.0f} mm: {velocity_mm_s:+.0f} mm/s", flush=True)
        if time.monotonic() > end_s:
            break


def fingers_on(state: PlateState, x_mm: float, radius_mm: float) -> int:
    """Return how many fingers touch the patch."""
    return sum(not one.virtual and math.hypot(one.x_mm - x_mm, one.y_mm) <= radius_mm for one in state.fingers)


if __name__ == "__main__":
    main()

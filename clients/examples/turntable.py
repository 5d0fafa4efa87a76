"""A record with grooves that turns at 33 revolutions a minute: a finger on it drags it along, or holds it."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence

from hapticd_client import Circle, Client, Grating, HapticdError, PlateState

RADIUS_MM, FREE_RAD_S, MOST_RAD_S = 55.0, -33.3 * 2 * math.pi / 60, 20.0


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, epilog="example: hapticd run --sim &  python turntable.py")
    parser.add_argument("--groove-mm", type=float, default=6.0, help="from one groove to the next (%(default)s mm)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            serve(plate, Grating(options.groove_mm, 1.5), time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def serve(plate: Client, grooves: Grating, end_s: float) -> None:
    """Turn the record, at the speed of the first finger on it while there is one."""
    angle_rad, t_ns, shown = 0.0, 0, ""
    held: dict[int | str, float] = {}
    for state in plate.states():
        step_s, t_ns = (state.t_ns - (t_ns or state.t_ns)) * 1e-9, state.t_ns
        now = bearings(state)
        turned = [math.remainder(angle - held[key], 2 * math.pi) for key, angle in now.items() if key in held]
        speed_rad_s = turned[0] / step_s if turned and step_s > 0.0 else 0.0 if now else FREE_RAD_S
        angle_rad = math.remainder(angle_rad + (turned[0] if turned else speed_rad_s * step_s), 2 * math.pi)
        held, turning_rad_s = now, max(-MOST_RAD_S, min(speed_rad_s, MOST_RAD_S))
        pose = {"angle_rad": angle_rad, "turning_rad_s": turning_rad_s, "t_pose_ns": t_ns}
        plate.surface("record", Circle(RADIUS_MM), grating=grooves, wait=False, **pose)
        if shown != (shown := f"fingers on the record: {len(now)}"):
            print(shown, flush=True)
        if time.monotonic() > end_s:
            break


def bearings(state: PlateState) -> dict[int | str, float]:
    """Return the angle of each finger on the record about its centre, oldest finger first."""
    on_it = [one for one in state.fingers if not one.virtual and math.hypot(one.x_mm, one.y_mm) < RADIUS_MM]
    return {one.id: math.atan2(one.y_mm, one.x_mm) for one in on_it}


if __name__ == "__main__":
    main()

"""A game: a slippery patch runs over sticky glass. A finger that stays on it for half a second has caught it."""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Sequence

from hapticd_client import Circle, Client, HapticdError

RADIUS_MM, REACH_MM, HOLD_S, FASTER = 13.0, 50.0, 0.5, 1.2


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, epilog="example: hapticd run --sim &  python catch.py")
    parser.add_argument("--speed", type=float, default=25.0, help="of the first patch (%(default)s mm/s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            play(plate, options.speed, random.Random(), time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def play(plate: Client, speed_mm_s: float, chance: random.Random, end_s: float) -> None:
    """Let the patch run from place to place, each x + jy, and count catches."""
    print("Catch the slippery patch: keep a finger on it", flush=True)
    caught, held_s, t_ns, way_mm_s = 0, 0.0, 0, 0j
    place_mm = goal_mm = somewhere(chance)
    for state in plate.states():
        step_s, t_ns = (state.t_ns - (t_ns or state.t_ns)) * 1e-9, state.t_ns
        place_mm += way_mm_s * step_s
        is_held = any(abs(complex(one.x_mm, one.y_mm) - place_mm) < RADIUS_MM for one in state.fingers)
        held_s = held_s + step_s if is_held else 0.0
        if held_s > HOLD_S:
            caught, held_s, speed_mm_s = caught + 1, 0.0, FASTER * speed_mm_s
            place_mm = goal_mm = somewhere(chance)
            print(f"{caught} caught; the next one runs at {speed_mm_s:.0f} mm/s", flush=True)
        if abs(goal_mm - place_mm) < RADIUS_MM / 2:
            goal_mm = somewhere(chance)
            way_mm_s = speed_mm_s * (goal_mm - place_mm) / max(abs(goal_mm - place_mm), 1e-9)
            at = {"position_mm": (place_mm.real, place_mm.imag), "velocity_mm_s": (way_mm_s.real, way_mm_s.imag)}
            plate.surface("patch", Circle(RADIUS_MM), friction=0.05, t_pose_ns=t_ns, wait=False, **at)
        if time.monotonic() > end_s:
            break


def somewhere(chance: random.Random) -> complex:
    return complex(chance.uniform(-REACH_MM, REACH_MM), chance.uniform(-REACH_MM, REACH_MM))


if __name__ == "__main__":
    main()

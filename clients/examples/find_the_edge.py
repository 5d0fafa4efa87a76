"""A game for two fingers: somewhere the glass turns from slippery to sticky. Catch that edge between your fingers!

Left of the edge the plate is slippery, right of it sticky, for each finger by itself. When one is on either side of it
and they are close enough together, the edge is caught, and another one is hidden.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Sequence

from hapticd_client import Client, FingerState, HapticdError, Map, RefusedError

PLATE_MM = 137.5
PIXELS = 128
REACH_MM = 40.0  # edges lie within this distance of the plate's middle
MAX_APART_MM = 60.0  # wherever caught fingers are, there is room for the next edge


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python find_the_edge.py --apart-mm 30",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--apart-mm", type=float, default=25.0, help="how close together is enough (%(default)s mm)")
    parser.add_argument("--high-um", type=float, default=1.5, help="amplitude where it slips (%(default)s um)")
    parser.add_argument("--seed", type=int, help="of where edges are hidden (default: none, so always others)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long a game takes (%(default)s)")
    options = parser.parse_args(arguments)
    if not 0 < options.apart_mm <= MAX_APART_MM:
        parser.error(f"--apart-mm: {options.apart_mm:g} is out of bounds, give 0 .. {MAX_APART_MM:g}.")

    try:
        with Client(options.endpoint) as plate:
            play(plate, options.apart_mm, options.high_um, random.Random(options.seed), options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def play(plate: Client, apart_mm: float, high_um: float, rng: random.Random, seconds: float) -> None:
    """Hide edge after edge until the time is over, and tell the score."""
    print(f"Two fingers on the plate: catch the edge, {apart_mm:g} mm apart or less. {seconds:g} s from now!")
    edge_mm, caught = rng.uniform(-REACH_MM, REACH_MM), 0
    t_hidden_s = time.monotonic()
    end_s = t_hidden_s + seconds
    on_map: set[tuple[int, int | str]] = set()
    for state in plate.states():
        fingers = [finger for finger in state.fingers if not finger.virtual]
        for finger in fingers:
            if (state.instance, finger.id) not in on_map:
                on_map.add((state.instance, finger.id))
                hide(plate, finger, edge_mm, high_um)
        now_s = time.monotonic()
        if is_caught(fingers, edge_mm, apart_mm):
            caught += 1
            print(f"Caught at x = {edge_mm:+.0f} mm after {now_s - t_hidden_s:.1f} s: {caught}")
            edge_mm, t_hidden_s = elsewhere(rng, fingers), now_s
            on_map.clear()
        if now_s > end_s:
            break
    print(f"Score: {caught} in {seconds:g} s")


def hide(plate: Client, finger: FingerState, edge_mm: float, high_um: float) -> None:
    """Let a finger feel where the edge is; another program's fingers do not play."""
    slippery = round((edge_mm / PLATE_MM + 0.5) * PIXELS)
    try:
        plate.set(finger, map=Map([[255] * slippery + [0] * (PIXELS - slippery)], high_um))
    except RefusedError as refusal:
        print(refusal)


def is_caught(fingers: Sequence[FingerState], edge_mm: float, apart_mm: float) -> bool:
    """Two fingers, close together, and the edge between them."""
    if len(fingers) != 2:
        return False
    left_mm, right_mm = sorted(finger.x_mm for finger in fingers)
    return left_mm < edge_mm < right_mm and right_mm - left_mm <= apart_mm


def elsewhere(rng: random.Random, fingers: Sequence[FingerState]) -> float:
    """A place for the next edge that is not between these fingers already."""
    left_mm, right_mm = sorted(finger.x_mm for finger in fingers)
    while left_mm < (edge_mm := rng.uniform(-REACH_MM, REACH_MM)) < right_mm:
        pass
    return edge_mm


if __name__ == "__main__":
    main()

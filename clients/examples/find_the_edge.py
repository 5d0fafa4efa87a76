"""A game for two fingers: catch the hidden edge between a slippery and a sticky half of the plate.

The plate is slippery left of the edge and sticky right of it. The edge is caught when one finger is on either side and
they are close enough together; then another edge is hidden.
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Sequence

from hapticd_client import Client, FingerState, HapticdError, Map, RefusedError

PLATE_MM = 137.5
PIXELS = 128
REACH_MM = 40.0  # largest distance of an edge from the plate's centre
MAX_APART_MM = 60.0  # leaves room for the next edge outside the fingers


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python find_the_edge.py --apart-mm 30",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--apart-mm", type=float, default=25.0, help="largest distance of the fingers (%(default)s mm)")
    parser.add_argument("--friction", type=float, default=0.49, help="of the slippery half, 0 .. 1 (%(default)s)")
    parser.add_argument("--seed", type=int, help="seed of the hidden edges (default: random)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=60.0, help="length of the game (%(default)s)")
    options = parser.parse_args(arguments)
    if not 0 < options.apart_mm <= MAX_APART_MM:
        parser.error(f"--apart-mm: {options.apart_mm:g} is out of bounds, give 0 .. {MAX_APART_MM:g}.")

    try:
        with Client(options.endpoint) as plate:
            play(plate, options.apart_mm, options.friction, random.Random(options.seed), options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def play(plate: Client, apart_mm: float, friction: float, rng: random.Random, seconds: float) -> None:
    """Hide one edge after the other until the time is over, then print the score."""
    print(f"Two fingers on the plate: catch the edge, at most {apart_mm:g} mm apart, within {seconds:g} s!")
    edge_mm, caught = rng.uniform(-REACH_MM, REACH_MM), 0
    t_hidden_s = time.monotonic()
    end_s = t_hidden_s + seconds
    on_map: set[tuple[int, int | str]] = set()
    for state in plate.states():
        fingers = [finger for finger in state.fingers if not finger.virtual]
        for finger in fingers:
            if (state.instance, finger.id) not in on_map:
                on_map.add((state.instance, finger.id))
                hide(plate, finger, edge_mm, friction)
        now_s = time.monotonic()
        if is_caught(fingers, edge_mm, apart_mm):
            caught += 1
            print(f"Caught at x = {edge_mm:+.0f} mm after {now_s - t_hidden_s:.1f} s: {caught}")
            edge_mm, t_hidden_s = elsewhere(rng, fingers), now_s
            on_map.clear()
        if now_s > end_s:
            break
    print(f"Score: {caught} in {seconds:g} s")


def hide(plate: Client, finger: FingerState, edge_mm: float, friction: float) -> None:
    """Set the edge for a finger; fingers of other clients do not take part."""
    slippery = round((edge_mm / PLATE_MM + 0.5) * PIXELS)
    try:
        plate.set(finger, map=Map([[255] * slippery + [0] * (PIXELS - slippery)], frictions=(1.0, friction)))
    except RefusedError as refusal:
        print(refusal)


def is_caught(fingers: Sequence[FingerState], edge_mm: float, apart_mm: float) -> bool:
    """Return whether the edge is between two fingers that are close together."""
    if len(fingers) != 2:
        return False
    left_mm, right_mm = sorted(finger.x_mm for finger in fingers)
    return left_mm < edge_mm < right_mm and right_mm - left_mm <= apart_mm


def elsewhere(rng: random.Random, fingers: Sequence[FingerState]) -> float:
    """Return a position for the next edge that is not between these fingers."""
    left_mm, right_mm = sorted(finger.x_mm for finger in fingers)
    while left_mm < (edge_mm := rng.uniform(-REACH_MM, REACH_MM)) < right_mm:
        pass
    return edge_mm


if __name__ == "__main__":
    main()

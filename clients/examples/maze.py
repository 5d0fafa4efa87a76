"""A maze: slippery glass with sticky walls from left to right, each with a gap to be felt."""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, Rectangle

WALLS_MM = (-40.0, -20.0, 0.0, 20.0, 40.0)  # their places along y
HALF_MM, GAP_MM, THICK_MM = 68.0, 16.0, 4.0


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, epilog="example: hapticd run --sim &  python maze.py")
    parser.add_argument("--seed", type=int, help="of the gaps (default: others each time)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            play(plate, random.Random(options.seed), time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def lay(plate: Client, chance: random.Random) -> None:
    """Lay the glass, and each wall as a piece on the left and one on the right of its gap."""
    plate.surface("glass", friction=0.05)
    for number, y_mm in enumerate(WALLS_MM):
        gap_mm = chance.uniform(-45.0, 45.0)
        for side, edge_mm, end_mm in (("left", gap_mm - GAP_MM / 2, -HALF_MM), ("right", gap_mm + GAP_MM / 2, HALF_MM)):
            wall, middle_mm = Rectangle(abs(end_mm - edge_mm), THICK_MM), ((edge_mm + end_mm) / 2, y_mm)
            plate.surface(f"wall {number} {side}", wall, friction=1.0, position_mm=middle_mm, z=1)


def play(plate: Client, chance: random.Random, end_s: float) -> None:
    """Lay a maze, and another one each time a finger that was before all walls gets behind them."""
    lay(plate, chance)
    print(f"Find the gaps of {len(WALLS_MM)} walls, from the front edge to the back", flush=True)
    started: dict[int | str, float] = {}
    for state in plate.states():
        for finger in state.fingers:
            if finger.y_mm < WALLS_MM[0]:
                started[finger.id] = time.monotonic()
            elif finger.y_mm > WALLS_MM[-1] and finger.id in started:
                print(f"finger {finger.id}: out after {time.monotonic() - started.pop(finger.id):.1f} s", flush=True)
                lay(plate, chance)
        if time.monotonic() > end_s:
            break


if __name__ == "__main__":
    main()

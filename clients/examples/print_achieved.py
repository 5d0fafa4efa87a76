"""Print target and achieved amplitude of each finger; `!` marks lines where a finger misses what was asked."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, PlateState


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: hapticd run --sim &  python print_achieved.py --every 0.2"
    )
    parser.add_argument("--every", type=float, default=0.5, help="seconds between lines (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            show(plate, options.every, time.monotonic() + options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def show(plate: Client, every_s: float, end_s: float) -> None:
    """Print the newest state periodically; those in between are dropped."""
    next_line_s = time.monotonic()
    for state in plate.states():
        now_s = time.monotonic()
        if now_s >= next_line_s:
            next_line_s = now_s + every_s
            print(line(state), flush=True)
        if now_s > end_s:
            break


def line(state: PlateState) -> str:
    """Format one state: target -> achieved for every finger with a target; ! where one is missed."""
    fingers = [
        f"{finger.id}: {finger.target_um:.2f} -> {finger.achieved_um:.2f} um"
        for finger in state.fingers
        if finger.target_um is not None and finger.achieved_um is not None
    ]
    return f"{'!' if state.misses_target else ' '} {state.state:7} {'   '.join(fingers) or 'no targets'}"


if __name__ == "__main__":
    main()

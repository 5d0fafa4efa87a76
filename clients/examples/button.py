"""A button that clicks: press on it, and a short slip under the finger answers; let go, and it is armed again.

The trackpad reports how hard each finger presses. The daemon starts the click by itself, within one frame.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from hapticd_client import Circle, Client, HapticdError, OnCrossing, OnPressure, Pulse

RADIUS_MM = 18.0


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim --scenario press &  python button.py",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--threshold", type=float, default=0.35, help="pressure that clicks, 0.01 .. 1 (%(default)s)")
    parser.add_argument("--high-um", type=float, default=2.0, help="height of the click (%(default)s um)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            lay(plate, options.threshold, options.high_um)
            print(f"A button of {2 * RADIUS_MM:g} mm in the middle of the plate: press it", flush=True)
            count(plate, options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def lay(plate: Client, threshold: float, high_um: float) -> None:
    """Lay a sticky button, with a tick at its edge and a click at the pressure."""
    plate.surface("button", Circle(RADIUS_MM), friction=1.0)
    plate.effect("edge", Pulse(0.5 * high_um, 0.012, 0.002), start=OnCrossing("button"))
    plate.effect("click", Pulse(high_um, 0.02, 0.002), on="button", start=OnPressure(threshold))


def count(plate: Client, seconds: float) -> None:
    """Print each click."""
    clicks = 0
    for event in plate.events(seconds):
        if event.kind == "begun" and event.effect == "click" and event.client == plate.name:
            clicks += 1
            print(f"finger {event.finger}: click {clicks}", flush=True)


if __name__ == "__main__":
    main()

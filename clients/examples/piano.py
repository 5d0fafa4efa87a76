"""A piano for fingertips: eight keys, each of which hums at its own pitch while a finger is on it."""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, Modulation, OnEntering, Rectangle

NOTES_HZ = {"C": 65.4, "D": 73.4, "E": 82.4, "F": 87.3, "G": 98.0, "A": 110.0, "B": 123.5, "c": 130.8}
KEY_MM, GAP_MM, HEIGHT_MM = 14.0, 2.0, 90.0


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: hapticd run --sim &  python piano.py --friction 0.1"
    )
    parser.add_argument("--friction", type=float, default=0.0, help="of a key, 0 (most slippery) .. 1 (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            lay(plate, options.friction)
            print(f"Keys {' '.join(NOTES_HZ)} from left to right: touch them", flush=True)
            listen(plate, options.seconds)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def lay(plate: Client, friction: float) -> None:
    """Lay the keys. A finger that enters one feels its pitch until it leaves."""
    for index, (note, frequency_hz) in enumerate(NOTES_HZ.items()):
        x_mm = (index - 3.5) * (KEY_MM + GAP_MM)
        plate.surface(note, Rectangle(KEY_MM, HEIGHT_MM), friction=friction, position_mm=(x_mm, 0))
        plate.effect(note, Modulation(frequency_hz, depth=0.9), on=note, start=OnEntering(note))


def listen(plate: Client, seconds: float) -> None:
    """Print each key that a finger enters."""
    for event in plate.events(seconds):
        if event.kind == "begun" and event.client == plate.name:
            print(f"finger {event.finger}: {event.effect}, {NOTES_HZ[event.effect]:g} Hz", flush=True)


if __name__ == "__main__":
    main()

"""The picture of a camera under the fingers, ten times a second; without OpenCV or a camera, a light goes round."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

from hapticd_client import Client, HapticdError, Map

SIDE, RATE_HZ, ROUND_S, LIGHT, HIGH_UM = 64, 10.0, 4.0, 12.0, 1.5


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python webcam.py --camera 1",
    )
    parser.add_argument("--camera", type=int, default=0, help="number of the camera (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate:
            picture = camera(options.camera) or light
            print(f"the picture of {'a light' if picture is light else 'the camera'}, 10 a second", flush=True)
            begin_s = time.monotonic()
            while (t_s := time.monotonic() - begin_s) < options.seconds:
                plate.surface("picture", map=Map(picture(t_s), HIGH_UM), wait=False)
                time.sleep(1 / RATE_HZ)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def camera(number: int) -> Callable[[float], Any] | None:
    """Return what takes a picture of SIDE x SIDE grey levels; None without a camera."""
    try:
        import cv2  # type: ignore[import-not-found]
    except ImportError:
        return None
    capture = cv2.VideoCapture(number)
    return (lambda _: cv2.resize(cv2.cvtColor(capture.read()[1], 6), (SIDE, SIDE))) if capture.isOpened() else None


def light(t_s: float) -> list[list[int]]:
    """Return a bright spot on its way round the plate."""
    turn = 2 * math.pi * t_s / ROUND_S
    x, y = SIDE * (0.5 + 0.3 * math.cos(turn)), SIDE * (0.5 - 0.3 * math.sin(turn))
    return [
        [round(255 * math.exp(-(((c - x) ** 2 + (r - y) ** 2) / LIGHT**2))) for c in range(SIDE)] for r in range(SIDE)
    ]


if __name__ == "__main__":
    main()

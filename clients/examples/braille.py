"""A word in Braille, large enough for a fingertip on glass: sticky dots on slippery ground."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from hapticd_client import Client, HapticdError, Map

FIRST_TEN = ("1", "12", "14", "145", "15", "124", "1245", "125", "24", "245")  # dots of a .. j
LETTERS = {chr(97 + n): FIRST_TEN[n % 10] + ("" if n < 10 else "3" if n < 20 else "36") for n in range(26)}
LETTERS |= {"w": "2456", "x": "1346", "y": "13456", "z": "1356", " ": ""}
PLATE_MM, SIDE, DOT_MM, HIGH_UM = 137.5, 550, 2.6, 1.5  # four pixels per mm
PITCH_MM, CELL_MM, MOST = 9.0, 25.0, 5  # between dots, between letters; letters on the plate


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, epilog="example: hapticd run --sim &  python braille.py hi")
    parser.add_argument("word", nargs="?", default="glass", help=f"up to {MOST} letters a .. z (%(default)s)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)
    word = options.word.lower()
    if len(word) > MOST or not set(word) <= LETTERS.keys():
        parser.error(f"word: must have at most {MOST} letters a .. z.")
    try:
        with Client(options.endpoint) as plate:
            plate.surface("word", map=Map(plate.asset(levels(word)), HIGH_UM))
            print(f"{word}: {' '.join(''.join(sorted(LETTERS[one])) or '-' for one in word)}", flush=True)
            time.sleep(min(options.seconds, 1e6))
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def dots_mm(word: str) -> list[tuple[float, float]]:
    """Return the places of all dots: 1 2 3 down the left of a letter, 4 5 6 down its right."""
    left_mm = -0.5 * CELL_MM * (len(word) - 1) - 0.5 * PITCH_MM
    return [
        (left_mm + CELL_MM * index + PITCH_MM * (dot > "3"), PITCH_MM * (1 - (int(dot) - 1) % 3))
        for index, letter in enumerate(word)
        for dot in LETTERS[letter]
    ]


def levels(word: str) -> list[bytearray]:
    """Return the picture: black dots on white."""
    scale, rows = (SIDE - 1) / PLATE_MM, [bytearray(b"\xff" * SIDE) for _ in range(SIDE)]
    for x_mm, y_mm in dots_mm(word):
        column, row, reach = (x_mm + 0.5 * PLATE_MM) * scale, (0.5 * PLATE_MM - y_mm) * scale, DOT_MM * scale
        for r in range(round(row - reach), round(row + reach) + 1):
            half = round(max(reach**2 - (r - row) ** 2, 0) ** 0.5)
            rows[r][round(column) - half : round(column) + half + 1] = bytes(2 * half + 1)
    return rows


if __name__ == "__main__":
    main()

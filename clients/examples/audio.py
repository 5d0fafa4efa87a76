"""A sound under the fingers: how loud it is becomes slipperiness, its low pitch a vibration.

Without a file it plays a beating heart.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import wave
from array import array
from collections.abc import Sequence
from pathlib import Path

from hapticd_client import Client, HapticdError, content

RATE_HZ, BEAT_S, SECONDS = 8000, 0.9, 3.6


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: hapticd run --sim &  python audio.py song.wav",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("sound", nargs="?", type=Path, help="a .wav, or another file of hapticd_client.content")
    parser.add_argument("--high-um", type=float, default=1.5, help="amplitude of the loudest part (%(default)s um)")
    parser.add_argument("--endpoint", help="the daemon's runtime directory")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after so long (default: Ctrl-C)")
    options = parser.parse_args(arguments)

    try:
        with Client(options.endpoint) as plate, tempfile.TemporaryDirectory() as folder:
            score = content.load(options.sound or heart(Path(folder, "heart.wav")), high_um=options.high_um)
            print(f"{score.title}, again and again: stroke the plate", flush=True)
            score.play(plate, options.seconds, loops=True)
    except KeyboardInterrupt:
        pass
    except HapticdError as error:
        parser.exit(1, f"{error}\n")


def heart(path: Path) -> Path:
    """Write the sound of a heart: two thuds of 60 Hz in each beat."""
    thuds_s = [beat * BEAT_S + second for beat in range(round(SECONDS / BEAT_S)) for second in (0.0, 0.28)]
    samples = array("h", bytes(2 * round(SECONDS * RATE_HZ)))
    for thud_s in thuds_s:
        for index in range(round(0.2 * RATE_HZ)):
            t_s = index / RATE_HZ
            height = math.sin(math.pi * t_s / 0.2) ** 2 * math.sin(2 * math.pi * 60 * t_s)
            samples[round(thud_s * RATE_HZ) + index] += round(20000 * height)
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, RATE_HZ, 0, "NONE", ""))
        file.writeframes(samples.tobytes())
    return path


if __name__ == "__main__":
    main()

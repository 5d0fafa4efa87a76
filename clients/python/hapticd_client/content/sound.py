"""WAV files: how loud a sound is becomes an intensity, its pitch below 300 Hz a modulation.

The loudness is taken every 10 ms, over 20 ms, and the pitch every 100 ms, each rounded to whole samples. The pitch is
the rate at which the sound crosses zero once its overtones are averaged away. The loudest frame is intensity 1.
"""

from __future__ import annotations

import math
import os
import sys
import wave
from array import array
from collections.abc import Sequence
from itertools import pairwise

from ..errors import RefusedError
from .dropped import drop
from .track import MAX_S, Tone, Track

FRAME_S = 0.010
PITCH_S = 0.1
AVERAGED_HZ = 1200.0  # the rate after averaging: what is above 600 Hz is gone
LOWEST_HZ, HIGHEST_HZ = 20.0, 300.0
LEAST_SHARE = 0.3  # of the loudness that must be in the averaged sound, to be felt as a tone
QUIET = 0.01  # of the loudest part: less needs no pitch
MAX_TONE_S = 20.0  # one effect lasts a minute at most
SAME_PITCH = 0.06  # a semitone


def track_of(path: str | os.PathLike[str]) -> Track:
    """Return the track of a WAV file. Raises RefusedError."""
    samples, rate_hz = _mono(path)
    size = round(rate_hz * FRAME_S)
    loudness = _rms(samples, size)
    loudest = max(loudness, default=0.0)
    if loudest == 0.0:
        raise RefusedError(f"{os.fspath(path)}: has no sound.")
    ends = (min((index + 1) * size, len(samples)) / rate_hz for index in range(len(loudness)))
    track = Track([[(end_s, one / loudest) for end_s, one in zip(ends, loudness, strict=True)]])
    for tone in _tones(samples, rate_hz):
        track.tone(tone)
    return track


def _mono(path: str | os.PathLike[str]) -> tuple[Sequence[float], int]:
    """Return samples, the mean of all channels, and their rate."""
    try:
        with wave.open(os.fspath(path), "rb") as file:
            channels, width, rate_hz, frames = file.getparams()[:4]
            if rate_hz < 2 / FRAME_S or frames > MAX_S * rate_hz:
                raise RefusedError(f"{os.fspath(path)}: must have 200 samples per second or more, in {MAX_S:g} s.")
            data = file.readframes(frames)
    except (wave.Error, EOFError) as error:
        why = str(error) or "it ends early"
        raise RefusedError(f"{os.fspath(path)}: is no WAV file of whole numbers ({why}): save it as 16 bit.") from None
    except OSError as error:
        raise RefusedError(f"{os.fspath(path)}: cannot be read ({error.strerror or error}).") from None
    if channels > 1:
        drop(f"{channels} channels: their mean is played")
    samples = _whole_numbers(data, width)
    ends = range(channels, len(samples) + 1, channels)
    return [math.fsum(samples[end - channels : end]) / channels for end in ends], rate_hz


def _whole_numbers(data: bytes, width: int) -> Sequence[int]:
    if width == 1:
        return [one - 128 for one in data]
    if width == 3:  # the two upper bytes are enough
        data, width = b"".join(data[at + 1 : at + 3] for at in range(0, len(data) - 2, 3)), 2
    samples = array("h" if width == 2 else "i", data[: len(data) // width * width])
    if sys.byteorder == "big":
        samples.byteswap()
    return samples


def _rms(samples: Sequence[float], size: int) -> list[float]:
    """Return the RMS of each frame and the one after it, so that a low pitch is no ripple of the loudness."""
    means = []
    for at in range(0, len(samples), size):
        frame = samples[at : at + size]
        means.append(math.fsum(one * one for one in frame) / len(frame))
    return [math.sqrt(0.5 * (before + after)) for before, after in pairwise([*means, means[-1]])] if means else []


def _tones(samples: Sequence[float], rate_hz: int) -> list[Tone]:
    size = max(round(rate_hz / AVERAGED_HZ), 1)
    averaged = [math.fsum(samples[at : at + size]) / size for at in range(0, len(samples) - size + 1, size)]
    count = max(round(PITCH_S * rate_hz / size), 1)
    pitch_s = count * size / rate_hz
    tones: list[Tone] = []
    sizes: list[float] = []
    for index, at in enumerate(range(0, len(averaged) - count + 1, count)):
        part = averaged[at : at + count]
        whole = samples[at * size : (at + count) * size]
        loud, low = math.fsum(one * one for one in whole) / len(whole), math.fsum(one * one for one in part) / count
        sizes.append(loud)
        frequency_hz = _frequency_hz(part, rate_hz / size)
        share = math.sqrt(low / loud) if loud > 0.0 else 0.0
        if share >= LEAST_SHARE and LOWEST_HZ <= frequency_hz <= HIGHEST_HZ:
            tones.append(Tone(index * pitch_s, (index + 1) * pitch_s, frequency_hz, min(share, 1.0)))
    if len(tones) < 0.5 * sum(loud >= QUIET * max(sizes) for loud in sizes):
        drop(f"sound without a pitch of {LOWEST_HZ:g} .. {HIGHEST_HZ:g} Hz: only its loudness is felt")
    return _joined(tones)


def _frequency_hz(part: Sequence[float], rate_hz: float) -> float:
    """Return the frequency of zero crossings, from the first to the last; 0 with less than two."""
    crossings = [
        index + before / (before - after)
        for index, (before, after) in enumerate(pairwise(part))
        if (before < 0.0) != (after < 0.0)
    ]
    return 0.5 * (len(crossings) - 1) * rate_hz / (crossings[-1] - crossings[0]) if len(crossings) > 1 else 0.0


def _joined(tones: Sequence[Tone]) -> list[Tone]:
    """Join tones of nearly the same pitch, so that a long one is one effect."""
    found: list[Tone] = []
    for tone in tones:
        before = found[-1] if found else tone
        is_next = math.isclose(before.end_s, tone.begin_s) and tone.end_s - before.begin_s <= MAX_TONE_S
        if is_next and abs(before.frequency_hz - tone.frequency_hz) <= SAME_PITCH * before.frequency_hz:
            found[-1] = Tone(before.begin_s, tone.end_s, before.frequency_hz, max(before.depth, tone.depth))
        else:
            found.append(tone)
    return found

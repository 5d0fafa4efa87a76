"""WAV files: how loud a sound is becomes an intensity, its pitch below 300 Hz a modulation.

The loudness is taken every 10 ms, over 20 ms, and the pitch every 100 ms, each rounded to whole samples. The pitch is
the rate at which the sound crosses zero once its overtones are averaged away. The loudest frame is intensity 1.
"""

from __future__ import annotations

import io
import math
import os
import wave
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from ..errors import RefusedError
from ..regular_file import open_regular
from .dropped import drop
from .track import Tone, Track, check_length

Floats = npt.NDArray[np.float32]

MAX_BYTES = 1 << 28
HEAD_BYTES = 1 << 20  # before the samples
MAX_SAMPLES = 30_000_000  # of all channels: ten minutes at 48 kHz, five in stereo
MAX_CHANNELS = 32
MAX_RATE_HZ = 192_000
BLOCK = 1 << 18  # samples that are read at once
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
    try:
        with open_regular(path, MAX_BYTES) as file:
            return _track(Sound(file, os.fspath(path)), os.fspath(path))
    except (wave.Error, EOFError) as error:
        why = str(error) or "it ends early"
        raise RefusedError(f"{os.fspath(path)}: is no WAV file of whole numbers ({why}): save it as 16 bit.") from None
    except OSError as error:
        raise RefusedError(f"{os.fspath(path)}: cannot be read ({error.strerror or error}).") from None


class Sound:
    """An open WAV file of a bounded size, read window by window: so it takes memory for a few."""

    def __init__(self, file: BinaryIO, path: str) -> None:
        """Raises RefusedError for more than can be played, wave.Error, EOFError."""
        head = io.BytesIO(file.read(HEAD_BYTES))  # which bounds the number of chunks, too
        with wave.open(head, "rb") as found:
            self._channels, self._width, self.rate_hz, frames = found.getparams()[:4]
            self._begin = head.tell()
        if not 2 / FRAME_S <= self.rate_hz <= MAX_RATE_HZ:
            raise RefusedError(
                f"{path}: has {self.rate_hz} samples per second, it must have {2 / FRAME_S:g} .. {MAX_RATE_HZ}: save "
                "it at another rate."
            )
        check_length(frames / self.rate_hz, path)
        if self._channels > MAX_CHANNELS:
            raise RefusedError(
                f"{path}: has {self._channels} channels, it must have {MAX_CHANNELS} at most: save it with fewer."
            )
        if frames * self._channels > MAX_SAMPLES:
            raise RefusedError(
                f"{path}: has {frames * self._channels} samples in all channels, it must have {MAX_SAMPLES} at most: "
                "divide it."
            )
        if self._width not in (1, 2, 3, 4):
            raise wave.Error(f"samples of {self._width} bytes")
        if self._channels > 1:
            drop(f"{self._channels} channels: their mean is played")
        self._file, self._frames = file, frames

    def windows(self, size: int) -> Iterator[Floats]:
        """Yield the mean of all channels from the begin on, some windows (n, size) at a time; a shorter one at last."""
        self._file.seek(self._begin)
        left, frames = self._frames, max(BLOCK // size, 1) * size
        while left > 0 and (data := self._file.read(min(frames, left) * self._channels * self._width)):
            left -= frames
            samples = _whole_numbers(data, self._width)
            whole = len(samples) // self._channels * self._channels
            mono = samples[:whole].reshape(-1, self._channels) @ np.full(
                self._channels, 1.0 / self._channels, np.float32
            )
            whole = len(mono) // size * size
            if whole:
                yield mono[:whole].reshape(-1, size)
            if len(mono) > whole:
                yield mono[whole:].reshape(1, -1)

    def means(self, size: int, *, of_squares: bool) -> tuple[Floats, int]:
        """Return the mean of each window, or of its squares, and the number of samples."""
        found, samples = [np.zeros(0, np.float32)], 0
        for part in self.windows(size):
            each = np.full(part.shape[1], 1.0 / part.shape[1], np.float32)
            found.append(np.einsum("ij,ij,j->i", part, part, each) if of_squares else part @ each)
            samples += part.size
        return np.concatenate(found), samples


def _track(sound: Sound, path: str) -> Track:
    size = round(sound.rate_hz * FRAME_S)
    means, samples = sound.means(size, of_squares=True)
    # Each frame with the one after it, so that a low pitch is no ripple of the loudness.
    loudness = np.sqrt(0.5 * (means + np.append(means[1:], means[-1:]))).tolist()
    loudest = max(loudness, default=0.0)
    if loudest == 0.0:
        raise RefusedError(f"{path}: has no sound.")
    ends = (min((index + 1) * size, samples) / sound.rate_hz for index in range(len(loudness)))
    track = Track([[(end_s, one / loudest) for end_s, one in zip(ends, loudness, strict=True)]])
    for tone in _tones(sound):
        track.tone(tone)
    return track


def _whole_numbers(data: bytes, width: int) -> Floats:
    if width == 1:
        return np.frombuffer(data, np.uint8).astype(np.float32) - np.float32(128.0)
    data = data[: len(data) // width * width]
    if width == 3:  # the two upper bytes are enough
        return np.frombuffer(data, np.uint8).reshape(-1, 3)[:, 1:].copy().view("<i2")[:, 0].astype(np.float32)
    return np.frombuffer(data, f"<i{width}").astype(np.float32)


def _tones(sound: Sound) -> list[Tone]:
    size = max(round(sound.rate_hz / AVERAGED_HZ), 1)
    averaged, samples = sound.means(size, of_squares=False)
    averaged = averaged[: samples // size]
    count = max(round(PITCH_S * sound.rate_hz / size), 1)
    pitch_s = count * size / sound.rate_hz
    loudness = sound.means(count * size, of_squares=True)[0][: len(averaged) // count].tolist()
    tones: list[Tone] = []
    for index, loud in enumerate(loudness):
        part = averaged[index * count : (index + 1) * count]
        frequency_hz = _frequency_hz(part.tolist(), sound.rate_hz / size)
        share = math.sqrt(float(np.mean(part * part)) / loud) if loud > 0.0 else 0.0
        if share >= LEAST_SHARE and LOWEST_HZ <= frequency_hz <= HIGHEST_HZ:
            tones.append(Tone(index * pitch_s, (index + 1) * pitch_s, frequency_hz, min(share, 1.0)))
    if len(tones) < 0.5 * sum(loud >= QUIET * max(loudness) for loud in loudness):
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

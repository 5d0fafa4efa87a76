"""WAV files: how loud a sound is becomes an intensity, its pitch below 300 Hz a modulation.

The loudness is taken every 10 ms, over 20 ms, and the pitch every 100 ms, each rounded to whole samples. The pitch is
the rate at which the sound crosses zero once its overtones are averaged away. The loudest frame is intensity 1.
"""

from __future__ import annotations

import io
import math
import os
import struct
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
PCM, EXTENSIBLE = 1, 0xFFFE
FORMATS = {2: "ADPCM", 3: "floating point", 6: "A-law", 7: "mu-law", 17: "ADPCM", 85: "MP3"}
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
    except OSError as error:
        raise RefusedError(f"{os.fspath(path)}: cannot be read ({error.strerror or error}).") from None


class Sound:
    """An open WAV file of a bounded size, read window by window: so it takes memory for a few."""

    def __init__(self, file: BinaryIO, path: str) -> None:
        """Raises RefusedError for more than can be played, and for what is not a WAV file of whole numbers."""
        self._file, self.rate_hz = file, 0
        size = file.seek(0, io.SEEK_END)
        file.seek(0)
        self._begin, samples_bytes = self._find_samples(io.BytesIO(file.read(HEAD_BYTES)), size, path)
        self._frames = samples_bytes // (self._channels * self._width)
        check_length(self._frames / self.rate_hz, path)
        _check(path, self._frames * self._channels, "samples in all channels", 0, MAX_SAMPLES, "divide it")
        if self._channels > 1:
            drop(f"{self._channels} channels: their mean is played")

    def _find_samples(self, head: BinaryIO, file_bytes: int, path: str) -> tuple[int, int]:
        """Read the chunks up to the samples; return where these begin and how many bytes they have."""
        start = head.read(12)
        if start[:4] not in (b"RIFF", b"RF64", b"BW64") or start[8:] != b"WAVE":
            raise RefusedError(f"{path}: is not a WAV file: it begins with {start!r}.")
        is_size_true = abs(int.from_bytes(start[4:8], "little") + 8 - file_bytes) <= 1
        long_bytes = 0  # of the samples, where 32 bits are too few
        while len(chunk := head.read(8)) == 8:
            name, size = struct.unpack("<4sI", chunk)
            begin = head.tell()
            if name == b"data":
                if not self.rate_hz:
                    raise RefusedError(f"{path}: has no format (chunk 'fmt ') before its samples: save it as 16 bit.")
                if size == 0xFFFFFFFF or (size == 0 and not is_size_true):  # streamed, or in the chunk `ds64`
                    size = long_bytes or file_bytes
                return begin, min(size, file_bytes - begin)
            if name == b"fmt " and len(form := head.read(min(size, 40))) >= 16:
                self._read_format(form, path)
            elif name == b"ds64":
                (long_bytes,) = struct.unpack("<8xQ", head.read(16).ljust(16, b"\0"))
            head.seek(begin + size + size % 2)
        raise RefusedError(f"{path}: has no samples (chunk 'data') in its first {HEAD_BYTES} bytes: save it as 16 bit.")

    def _read_format(self, form: bytes, path: str) -> None:
        tag, self._channels, self.rate_hz, _, frame_bytes, bits = struct.unpack_from("<HHIIHH", form)
        if tag == EXTENSIBLE and len(form) >= 26:
            (tag,) = struct.unpack_from("<H", form, 24)
        if tag != PCM:
            raise RefusedError(f"{path}: has samples of {FORMATS.get(tag, f'format {tag:#x}')}: save it as 16 bit.")
        _check(path, self.rate_hz, "samples per second", round(2 / FRAME_S), MAX_RATE_HZ, "save it at another rate")
        _check(path, self._channels, "channels", 1, MAX_CHANNELS, "save it as mono")
        self._width = (bits + 7) // 8
        if not 1 <= self._width <= 4 or frame_bytes != self._channels * self._width:
            raise RefusedError(
                f"{path}: has samples of {bits} bits in frames of {frame_bytes} bytes: save it as 16 bit."
            )

    def windows(self, size: int) -> Iterator[Floats]:
        """Yield the mean of all channels from the begin on, some windows (n, size) at a time; a shorter one at last."""
        self._file.seek(self._begin)
        left, frames = self._frames, max(BLOCK // size, 1) * size
        while left > 0 and (data := self._file.read(min(frames, left) * self._channels * self._width)):
            left -= frames
            data = data[: len(data) // (self._channels * self._width) * self._channels * self._width]
            weights = np.full(self._channels, 1.0 / self._channels, np.float32)
            mono = _whole_numbers(data, self._width).reshape(-1, self._channels) @ weights
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


def _check(path: str, count: int, what: str, low: int, high: int, remedy: str) -> None:
    if not low <= count <= high:
        raise RefusedError(f"{path}: has {count} {what}, it must have {low} .. {high}: {remedy}.")


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

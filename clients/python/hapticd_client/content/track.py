"""A score over time, before it is effects: intensities 0 .. 1 that add up, and tones that modulate their sum."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

from hapticd_contract.effects import Envelope, Modulation

from ..errors import RefusedError
from .dropped import drop
from .score import Timed

Point = tuple[float, float]  # s, intensity

MAX_S = 600.0  # of one file
MAX_POINTS = 100_000  # of all lines of one file
STEP_S = 0.003  # between points: a frame lasts 17 ms and carries about ten knots
CHUNK_POINTS = 80  # of one envelope: those of all effects that are sent have 1024 at most
CHUNK_S = 20.0
SHORTEST_S = 1e-6
FLAT = 0.004  # of full intensity: what a chord may miss
MIN_TONE_S = 0.001
MIN_HZ, MAX_HZ = 1.0, 300.0
BLUNT_PULSE_S, SHARP_PULSE_S = 0.030, 0.010
BLUNT_RISE_S, SHARP_RISE_S = 0.008, 0.003


@dataclass(frozen=True, slots=True)
class Tone:
    """A modulation from `begin_s` to `end_s`."""

    begin_s: float
    end_s: float
    frequency_hz: float
    depth: float = 1.0
    shape: Literal["sine", "square"] = "sine"


@dataclass(slots=True)
class Track:
    """Polylines of intensity, and tones."""

    lines: list[Sequence[Point]] = field(default_factory=list)
    tones: list[Tone] = field(default_factory=list)
    points: int = 0

    def count(self, points: int, where: str) -> None:
        """Count points before they are made. Raises RefusedError beyond MAX_POINTS."""
        self.points += points
        if self.points > MAX_POINTS:
            raise RefusedError(f"{where}: more than {MAX_POINTS} points in one file: divide it.")

    def pulse(self, begin_s: float, intensity: float, sharpness: float) -> None:
        """Add a transient: the sharper, the shorter and the steeper."""
        length_s = BLUNT_PULSE_S + (SHARP_PULSE_S - BLUNT_PULSE_S) * sharpness
        rise_s = BLUNT_RISE_S + (SHARP_RISE_S - BLUNT_RISE_S) * sharpness
        end_s = begin_s + length_s
        self.lines.append([(begin_s, 0.0), (begin_s + rise_s, intensity), (end_s - rise_s, intensity), (end_s, 0.0)])

    def tone(self, tone: Tone) -> None:
        """Add a tone, its frequency within what an effect can do."""
        frequency_hz = min(max(tone.frequency_hz, MIN_HZ), MAX_HZ)
        if frequency_hz != tone.frequency_hz:
            drop(f"frequencies beyond {MIN_HZ:g} .. {MAX_HZ:g} Hz: {tone.frequency_hz:g} becomes {frequency_hz:g}")
        self.tones.append(Tone(tone.begin_s, tone.end_s, frequency_hz, tone.depth, tone.shape))

    @property
    def length_s(self) -> float:
        """The instant at which all has ended."""
        return max([line[-1][0] for line in self.lines] + [tone.end_s for tone in self.tones], default=0.0)

    def effects(self, high_um: float, where: str) -> list[Timed]:
        """Return envelopes whose intensity 1 is `high_um`, and modulations, in the order in which they begin.

        Raises RefusedError beyond MAX_S.
        """
        check_length(self.length_s, where)
        found = [
            Timed(chunk[0][0], Envelope(tuple((t_s - chunk[0][0], value * high_um) for t_s, value in chunk)))
            for chunk in chunks(thinned(summed(self.lines)))
        ]
        for tone in one_at_a_time(self.tones):
            length_s = tone.end_s - tone.begin_s
            found.append(Timed(tone.begin_s, Modulation(tone.frequency_hz, tone.depth, tone.shape, length_s)))
        return sorted(found, key=lambda one: one.begin_s)


def check_length(length_s: float, where: str) -> None:
    """Raise RefusedError for what lasts longer than MAX_S."""
    if not length_s <= MAX_S:
        raise RefusedError(f"{where}: lasts {length_s:.4g} s, it must last {MAX_S:g} s at most: divide it.")


def summed(lines: Iterable[Sequence[Point]]) -> list[Point]:
    """Return the sum of polylines, each 0 beyond its ends, within 0 .. 1; two points at one instant are a step."""
    jumps: dict[float, float] = {}
    turns: dict[float, float] = {}
    for line in lines:
        for (t_s, value), (next_s, next_value) in pairwise([(line[0][0], 0.0), *line, (line[-1][0], 0.0)]):
            if next_s - t_s > SHORTEST_S:  # what is shorter is a step
                slope = (next_value - value) / (next_s - t_s)
                turns[t_s] = turns.get(t_s, 0.0) + slope
                turns[next_s] = turns.get(next_s, 0.0) - slope
            else:
                jumps[t_s] = jumps.get(t_s, 0.0) + next_value - value
    points: list[Point] = []
    value = slope = before_s = 0.0
    for t_s in sorted({*jumps, *turns}):
        value += slope * (t_s - before_s)
        points.append((t_s, within(value)))
        if abs(jumps.get(t_s, 0.0)) > 1e-9:
            value += jumps[t_s]
            points.append((t_s, within(value)))
        slope += turns.get(t_s, 0.0)
        before_s = t_s
    return points


def thinned(points: Sequence[Point]) -> list[Point]:
    """Return the points that a finger could miss: no two closer than STEP_S except those of a step, and none that its
    neighbours already give."""
    spaced: list[Point] = []
    for t_s, value in points:
        if spaced and 0.0 < t_s - spaced[-1][0] < STEP_S - 1e-6:
            continue
        if len(spaced) > 1 and spaced[-1][0] == spaced[-2][0] == t_s:
            spaced.pop()
        spaced.append((t_s, value if value >= 2.0 * FLAT else 0.0))
    kept: list[Point] = []
    for index, (t_s, value) in enumerate(spaced):
        if kept and index + 1 < len(spaced):
            (from_s, from_value), (to_s, to_value) = kept[-1], spaced[index + 1]
            is_step = t_s in (from_s, to_s)
            share = 0.0 if is_step else (t_s - from_s) / (to_s - from_s)
            if not is_step and abs(from_value + (to_value - from_value) * share - value) < FLAT:
                continue
        kept.append((t_s, value))
    if kept and kept[-1][0] != points[-1][0]:
        kept.append(points[-1])
    return kept


def chunks(points: Sequence[Point]) -> list[list[Point]]:
    """Divide a polyline into envelopes of a bounded length and number of points; what is silent is left out."""
    found: list[list[Point]] = []
    chunk: list[Point] = []
    for (t_s, value), (next_s, next_value) in pairwise(points):
        if value == next_value == 0.0 and next_s > t_s:
            if chunk:
                found.append(chunk)
            chunk = []
            continue
        if not chunk:
            chunk = [(t_s, value)]
        while next_s - chunk[0][0] > CHUNK_S:  # a long straight piece
            end_s = chunk[0][0] + CHUNK_S
            end_value = value + (next_value - value) * (end_s - t_s) / (next_s - t_s)
            found.append([*chunk, (end_s, end_value)])
            chunk, t_s, value = [(end_s, end_value)], end_s, end_value
        chunk.append((next_s, next_value))
        if len(chunk) >= CHUNK_POINTS and next_s > t_s:
            found.append(chunk)
            chunk = [(next_s, next_value)]
    found.append(chunk)
    return [chunk for chunk in found if len(chunk) > 1 and chunk[-1][0] - chunk[0][0] >= MIN_TONE_S]


def one_at_a_time(tones: Iterable[Tone]) -> list[Tone]:
    """Return the tones, each ended where the next begins."""
    found: list[Tone] = []
    for tone in sorted(tones, key=lambda tone: tone.begin_s):
        if found and found[-1].end_s > tone.begin_s + 1e-9:
            drop("tones at the same time: the one that begins last is played")
            before = found.pop()
            found.append(Tone(before.begin_s, tone.begin_s, before.frequency_hz, before.depth, before.shape))
        found.append(tone)
    return [tone for tone in found if tone.end_s - tone.begin_s >= MIN_TONE_S]


def within(value: float, high: float = 1.0) -> float:
    """Return a value clamped to 0 .. `high`; what rounding leaves of 0 is 0."""
    return 0.0 if value < 1e-9 else min(value, high)

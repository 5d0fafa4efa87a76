"""MPEG haptics files `.hjif` (ISO/IEC 23090-31): perceptions with channels, bands, effects and keyframes.

Positions are ticks of the file's `timescale` (1000 per second) for temporal modalities, and units of
10^unit_exponent m (-3: mm) along x, from the plate's left edge, for spatial ones. Frequencies of a spatial wave are
per metre. Signals have two signs, amplitudes of a plate one: what is felt is the size of the signal.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence

from hapticd_contract.contents import Grating

from ..errors import RefusedError
from .document import Document
from .dropped import drop
from .score import Layer
from .track import Point, Tone, Track, summed

TEMPORAL = ("Vibrotactile", "Vibration", "Pressure", "Force", "Electrotactile", "User-defined Temporal")
SPATIAL = ("Friction", "Vibrotactile Texture")
WAVES, LINES = ("Wave", "VectorialWave"), ("Curve", "Transient")
TICKS_PER_S = 1000.0
PLATE_MM = 137.5
SHARP_HZ = 250.0  # of a transient that is as short as possible
PIXELS = 128
MIN_PERIOD_MM, MAX_PERIOD_MM = 0.1, 1000.0
FARTHEST = 1e12  # s or mm

Placed = tuple[float, Document]  # position, and the effect that has the keyframes


def read(path: str | os.PathLike[str], high_um: float, plate_mm: float = PLATE_MM) -> tuple[Track, list[Layer]]:
    """Return the track of the temporal perceptions, and a layer for each band of the spatial ones. Raises
    RefusedError."""
    file = Document.read(path)
    if not file.objects("perceptions"):
        raise RefusedError(f"{os.fspath(path)}: has no perceptions.")
    if file.objects("syncs"):
        drop("synchronisation marks")
    ticks_per_s = file.number("timescale", TICKS_PER_S)
    if not ticks_per_s > 0.0:
        raise RefusedError(f"{os.fspath(path)}.timescale: must be above 0.")
    track, layers = Track(), list[Layer]()
    for perception in file.objects("perceptions"):
        modality = perception.text("perception_modality")
        if modality in TEMPORAL:
            _add_temporal(perception, 1.0 / ticks_per_s, track)
        elif modality in SPATIAL:
            unit_mm = 1000.0 * 10.0 ** min(max(perception.number("unit_exponent", -3.0), -12.0), 12.0)
            layers += _spatial(perception, modality, unit_mm, high_um, plate_mm, track)
        else:
            drop(f"perceptions of {modality or 'no modality'}")
    return track, layers


def _bands(perception: Document, track: Track) -> Iterable[tuple[Document, float, list[Placed]]]:
    """Yield each band that can be felt, its gain, and its effects with those of the library in place of references."""
    library = {one.number("id", -1.0): one for one in perception.objects("effect_library")}
    if perception.objects("reference_devices"):
        drop("reference devices")
    for channel in perception.objects("channels"):
        if "vertices" in channel or "direction" in channel or "actuator_target" in channel:
            drop("directions, vertices and actuators of channels: the whole plate plays them")
        gain = channel.number("gain", 1.0) * channel.number("mixing_coefficient", 1.0)
        for band in channel.objects("bands"):
            kind = band.text("band_type")
            if kind not in (*WAVES, *LINES):
                drop(f"bands {kind or 'of no type'}")
                continue
            if kind == "Curve" and band.text("curve_type", "Linear") not in ("Linear", "Unknown"):
                drop(f"curves {band.text('curve_type')}: they are played as straight lines")
            yield (
                band,
                gain,
                [_placed(one, library, track) for one in band.objects("effects") if _is_known(one, library)],
            )


def _is_known(effect: Document, library: dict[float, Document]) -> bool:
    kind = effect.text("effect_type", "Basis")
    if kind == "Reference" and effect.number("id", -1.0) in library:
        return True
    if kind != "Basis":
        drop(f"effects {kind}" if kind != "Reference" else "references to effects that the library does not have")
    return kind == "Basis"


def _placed(effect: Document, library: dict[float, Document], track: Track) -> Placed:
    is_reference = effect.text("effect_type", "Basis") == "Reference"
    source = library[effect.number("id")] if is_reference else effect
    track.count(source.count("keyframes"), effect.where)
    return effect.number("position", 0.0), source


def _keyframes(effect: Placed, unit: float) -> tuple[Document, list[Placed]]:
    """Return the effect that has the keyframes, and these with their positions. Raises RefusedError."""
    position, source = effect
    frames = [
        ((position + frame.number("relative_position", 0.0)) * unit, frame) for frame in source.objects("keyframes")
    ]
    for at, frame in frames:
        if not abs(at) < FARTHEST:
            raise RefusedError(f"{frame.where}.relative_position: is too far from 0.")
    return source, sorted(frames, key=lambda frame: frame[0])


def _line(frames: Sequence[Placed], gain: float) -> list[Point]:
    return [
        (at, min(abs(frame.number("amplitude_modulation") * gain), 1.0))
        for at, frame in frames
        if "amplitude_modulation" in frame
    ]


def _add_temporal(perception: Document, tick_s: float, track: Track) -> None:
    for band, gain, effects in _bands(perception, track):
        for effect in effects:
            source, frames = _keyframes(effect, tick_s)
            line = _line(frames, gain)
            if band.text("band_type") == "Transient":
                for at_s, frame in frames:
                    sharpness = min(abs(frame.number("frequency_modulation", SHARP_HZ)) / SHARP_HZ, 1.0)
                    height = min(abs(frame.number("amplitude_modulation", 1.0) * gain), 1.0)
                    track.pulse(max(at_s, 0.0), height, sharpness)
            elif len(line) > 1 and line[-1][0] > line[0][0] and frames[0][0] >= 0.0:
                track.lines.append(line)
                if band.text("band_type") in WAVES:
                    _add_tones(source, frames, line, band, track)


def _add_tones(source: Document, frames: Sequence[Placed], line: Sequence[Point], band: Document, track: Track) -> None:
    """Add a tone from each change of the frequency to the next; without one, of the band's middle."""
    signal = source.text("base_signal", "Sine")
    if signal not in ("Sine", "Square"):
        drop(f"signals {signal}: they are played as sines")
    if source.number("phase", 0.0) != 0.0:
        drop("phases of signals")
    middle_hz = 0.5 * (band.number("lower_frequency_limit", 0.0) + band.number("upper_frequency_limit", 300.0))
    marks = [(at, frame.number("frequency_modulation")) for at, frame in frames if "frequency_modulation" in frame]
    marks = marks or [(line[0][0], middle_hz)]
    if len({hz for _, hz in marks}) > 1:
        drop("frequencies that glide: each is played until the next")
    ends_s = [at for at, _ in marks[1:]] + [line[-1][0]]
    for (at_s, hz), end_s in zip(marks, ends_s, strict=True):
        if end_s > at_s:
            track.tone(Tone(at_s, end_s, hz, 1.0, "square" if signal == "Square" else "sine"))


def _spatial(
    perception: Document, modality: str, unit_mm: float, high_um: float, plate_mm: float, track: Track
) -> list[Layer]:
    layers: list[Layer] = []
    for band, gain, effects in _bands(perception, track):
        found = [_keyframes(effect, unit_mm) for effect in effects]
        if band.text("band_type") in LINES:
            lines = [line for _, frames in found if len(line := _line(frames, gain)) > 1]
            if lines:
                layers.append(_profile(lines, modality == "Friction", high_um, plate_mm))
            continue
        for _, frames in found:
            per_m = [frame.number("frequency_modulation") for _, frame in frames if "frequency_modulation" in frame]
            height = max((value for _, value in _line(frames, gain)), default=1.0)
            if len(set(per_m)) > 1 or len({value for _, value in _line(frames, gain)}) > 1:
                drop("spatial waves that change along the way: the first frequency and the largest height are felt")
            if per_m and per_m[0] > 0.0:
                period_mm = min(max(1000.0 / per_m[0], MIN_PERIOD_MM), MAX_PERIOD_MM)
                layers.append(Layer({"grating": Grating(period_mm, height * high_um)}))
    return layers


def _profile(lines: Sequence[Sequence[Point]], is_friction: bool, high_um: float, plate_mm: float) -> Layer:
    """Return a map over the whole plate that changes along x only."""
    points = summed(lines)
    levels = [round(255 * _at(points, plate_mm * pixel / (PIXELS - 1))) for pixel in range(PIXELS)]
    content: dict[str, object] = {"frictions": (0.0, 1.0)} if is_friction else {"high_um": high_um}
    return Layer(content, levels=[levels])


def _at(points: Sequence[Point], x_mm: float) -> float:
    """Return the value at a place, beyond the ends that of the nearer end."""
    before = points[0]
    for after in points:
        if x_mm < after[0]:
            share = 0.0 if after[0] == before[0] else max((x_mm - before[0]) / (after[0] - before[0]), 0.0)
            return before[1] + (after[1] - before[1]) * share
        before = after
    return before[1]

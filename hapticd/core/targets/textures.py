"""The textures of targets and surfaces: amplitude in um over plate mm, friction turned into amplitude.

The amplitude of a content is a function that is made once per request and called at every knot: plain arithmetic, about
a microsecond. It is finite and within the content's two amplitudes for every finite position; NaN and positions far
from any plate give what silence would.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from msgspec.structs import replace

from hapticd_contract.contents import Amplitude, Content, Friction, Gradient, Grating, LevelMap, Noise

from ..friction import FrictionCurve
from .assets import Assets

FINEST_MM: Final = 1e-3
FAR_MM: Final = 1e6  # no plate is that large: beyond, a wave's phase is rounding noise
PIECES_PER_WAVE: Final = 12.0  # chords err by 3 % of a smooth wave
PIECES_PER_CORNER: Final = 8.0  # of the least distance between two corners: by so much steps are spread
WAVES: Final = 16  # of a noise
MOST_RMS: Final = 3.0  # beyond so many deviations, where 16 waves seldom are, the noise is cut
_MASK: Final = 2**64 - 1
_GOLDEN: Final = 0.5 * (math.sqrt(5.0) - 1.0)

AmplitudeAt = Callable[[float, float], float]  # um over plate mm
_Wave = tuple[float, float, float, float]  # rad/mm along x and y, rad, um


class Textures:
    """The textures of one plate: of its friction, within its largest amplitude."""

    def __init__(self, curve: FrictionCurve, plate_size_mm: tuple[float, float], w_limit_um: float = math.inf) -> None:
        self.curve = curve
        self.plate_size_mm: Final = plate_size_mm
        self.w_limit_um: Final = w_limit_um
        self.assets: Final = Assets()
        self.speed_gain = 1.0  # of the amplitudes that give a friction, at the speed of the finger looked up next

    def refusal(self, content: Content) -> str:
        """Return why content asks for too much or lacks its asset; empty if it does not. A friction asks for as much as
        the plate can do."""
        asked_um = _highest_um(content)
        if asked_um <= self.w_limit_um:
            return self.assets.refusal(content)
        return f"cannot have {asked_um:g} um: ask for at most {self.w_limit_um:g} um."

    def amplitude(self, content: Content, size_mm: tuple[float, float] | None = None) -> AmplitudeAt:
        """Return the amplitude in um over mm, of a map that is spread over `size_mm`, else over the plate. A friction
        that needs more than the limit gets that, and one under a sliding finger more amplitude."""
        size_mm = self.plate_size_mm if size_mm is None else size_mm
        at_rest = self._at_rest(self.assets.resolved(content), size_mm)
        if self.curve.speed_mm_s == math.inf or not _asks_for_friction(content):
            return at_rest
        return lambda x_mm, y_mm: min(at_rest(x_mm, y_mm) * self.speed_gain, self.w_limit_um)

    def of_target(self, content: Content) -> AmplitudeAt | float:
        """Return `amplitude` over the plate, in um where it is the same all over and at any speed."""
        if isinstance(content, Amplitude):
            return min(content.amplitude_um, self.w_limit_um)
        if isinstance(content, Friction) and self.curve.speed_mm_s == math.inf:
            return self._of_friction_um(content.friction)
        return self.amplitude(content)

    def _at_rest(self, content: Content, size_mm: tuple[float, float]) -> AmplitudeAt:
        if isinstance(content, Amplitude):
            return _even(min(content.amplitude_um, self.w_limit_um))
        if isinstance(content, Friction):
            return _even(self._of_friction_um(content.friction))
        if isinstance(content, Gradient):
            return _gradient(content)
        if isinstance(content, Grating):
            return _sine(content) if content.duty_frac == 0.0 else _stripes(content)
        if isinstance(content, Noise):
            return _noise(content)
        if content.friction is None:
            return _image(content, size_mm)
        low, high = content.friction
        levels_um = [self._of_friction_um(low + (high - low) * level / 255.0) for level in range(256)]
        return _looked_up(_image(replace(content, low_um=0.0, high_um=255.0), size_mm), levels_um)

    def _of_friction_um(self, friction: float) -> float:
        return min(self.curve.amplitude_um(friction), self.w_limit_um)


def _asks_for_friction(content: Content) -> bool:
    return isinstance(content, Friction) or (isinstance(content, LevelMap) and content.friction is not None)


def _highest_um(content: Content) -> float:
    """Return the largest amplitude that content asks for; 0 where it asks for a friction."""
    if isinstance(content, Amplitude):
        return content.amplitude_um
    if isinstance(content, Gradient):
        return max(content.from_um, content.to_um)
    if isinstance(content, Grating):
        return max(content.low_um, content.high_um)
    if isinstance(content, Noise):
        return content.mean_um + MOST_RMS * content.rms_um
    return 0.0 if isinstance(content, Friction) or content.friction is not None else max(content.amplitudes_um)


def finest_mm(content: Content, size_mm: tuple[float, float]) -> float:
    """Return how far apart a texture's samples may be along a path; what is finer than FINEST_MM is not felt."""
    piece_mm = math.inf
    if isinstance(content, Gradient):
        piece_mm = content.length_mm / PIECES_PER_CORNER
    elif isinstance(content, Grating) and content.duty_frac == 0.0:
        piece_mm = content.period_mm / PIECES_PER_WAVE
    elif isinstance(content, Grating) and content.duty_frac < 1.0:
        piece_mm = min(content.duty_frac, 1.0 - content.duty_frac) * content.period_mm / PIECES_PER_CORNER
    elif isinstance(content, LevelMap):
        columns, rows = max(content.width - 1, 1), max(content.height - 1, 1)
        piece_mm = min(size_mm[0] / columns, size_mm[1] / rows) / PIECES_PER_CORNER
    elif isinstance(content, Noise):  # where it is cut it is nearly flat
        piece_mm = content.shortest_mm / PIECES_PER_WAVE
    return max(piece_mm, FINEST_MM)


# --- amplitudes of each ---


def _even(amplitude_um: float) -> AmplitudeAt:
    return lambda _x_mm, _y_mm: amplitude_um


def _gradient(gradient: Gradient) -> AmplitudeAt:
    """Linear along a direction, and constant beyond."""
    along_x, along_y = math.cos(gradient.angle_rad), math.sin(gradient.angle_rad)
    length_mm, from_um, to_um = gradient.length_mm, gradient.from_um, gradient.to_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        share = (x_mm * along_x + y_mm * along_y) / length_mm + 0.5
        if not share > 0.0:  # NaN too
            return from_um
        return from_um * (1.0 - share) + to_um * share if share < 1.0 else to_um

    return amplitude_um


def _sine(grating: Grating) -> AmplitudeAt:
    along_x, along_y = math.cos(grating.angle_rad), math.sin(grating.angle_rad)
    mean_um = 0.5 * (grating.low_um + grating.high_um)
    half_um = 0.5 * (grating.high_um - grating.low_um)
    wavenumber = 2.0 * math.pi / grating.period_mm
    low_um, cos = grating.low_um, math.cos

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        along_mm = x_mm * along_x + y_mm * along_y
        if not -FAR_MM <= along_mm <= FAR_MM:
            return low_um
        return mean_um + half_um * cos(wavenumber * along_mm)

    return amplitude_um


def _stripes(grating: Grating) -> AmplitudeAt:
    along_x, along_y = math.cos(grating.angle_rad), math.sin(grating.angle_rad)
    period_mm, half_crest_mm = grating.period_mm, 0.5 * grating.duty_frac * grating.period_mm
    low_um, high_um, remainder = grating.low_um, grating.high_um, math.remainder

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        along_mm = x_mm * along_x + y_mm * along_y
        if not -FAR_MM <= along_mm <= FAR_MM:
            return low_um
        return high_um if abs(remainder(along_mm, period_mm)) <= half_crest_mm else low_um

    return amplitude_um


def _looked_up(level_of: AmplitudeAt, levels_um: list[float]) -> AmplitudeAt:
    """Amplitudes of an image's 256 levels: bilinear in friction, which the curve turned into amplitude."""

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        level = level_of(x_mm, y_mm)
        below = min(int(level), 254)
        share = level - below
        return levels_um[below] * (1.0 - share) + levels_um[below + 1] * share

    return amplitude_um


def _image(image: LevelMap, size_mm: tuple[float, float]) -> AmplitudeAt:
    """Bilinear between pixel centres; the outermost lie on the plate's edges and reach beyond them."""
    width, height, levels = image.width, image.height, image.levels
    last_column, last_row = float(width - 1), float(height - 1)
    left_mm, top_mm = -0.5 * size_mm[0], 0.5 * size_mm[1]
    columns_per_mm, rows_per_mm = last_column / size_mm[0], last_row / size_mm[1]
    low_um, high_um = image.amplitudes_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        column = (x_mm - left_mm) * columns_per_mm
        row = (top_mm - y_mm) * rows_per_mm
        if not column > 0.0:  # NaN too
            column = 0.0
        elif column > last_column:
            column = last_column
        if not row > 0.0:
            row = 0.0
        elif row > last_row:
            row = last_row
        left, upper = int(column), int(row)
        right_share, lower_share = column - left, row - upper
        here = upper * width + left
        next_column = 1 if left < last_column else 0
        below = here + width if upper < last_row else here
        top_level = levels[here] + (levels[here + next_column] - levels[here]) * right_share
        bottom_level = levels[below] + (levels[below + next_column] - levels[below]) * right_share
        share = (top_level + (bottom_level - top_level) * lower_share) / 255.0
        return low_um * (1.0 - share) + high_um * share

    return amplitude_um


def _noise(target: Noise) -> AmplitudeAt:
    """A sum of plane waves, the same for the same seed on every machine."""
    waves = _waves(target)
    mean_um = target.mean_um
    low_um, high_um = max(mean_um - MOST_RMS * target.rms_um, 0.0), mean_um + MOST_RMS * target.rms_um

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        if not (-FAR_MM <= x_mm <= FAR_MM and -FAR_MM <= y_mm <= FAR_MM):
            return mean_um
        sum_um = mean_um
        for x_rad_mm, y_rad_mm, phase_rad, height_um in waves:
            # `math.cos` by its name is one call of C; a local name for it costs four times as much in machine code.
            sum_um += height_um * math.cos(x_rad_mm * x_mm + y_rad_mm * y_mm + phase_rad)
        return min(max(sum_um, low_um), high_um)

    return amplitude_um


def _waves(target: Noise) -> list[_Wave]:
    """Return the waves: evenly spread over octaves and directions (by the golden ratio, so that few look alike from all
    sides), with random phases and their sum's RMS as asked."""
    numbers = _uniform(target.seed, 3 * WAVES)
    octaves = math.log2(target.longest_mm / target.shortest_mm)
    waves: list[_Wave] = []
    for index in range(WAVES):
        octave, turn, phase = numbers[3 * index : 3 * index + 3]
        wavelength_mm = target.shortest_mm * 2.0 ** (octaves * (index + octave) / WAVES)
        angle_rad = math.pi * (index * _GOLDEN + turn / WAVES)
        rad_mm = 2.0 * math.pi / wavelength_mm
        height = (wavelength_mm / target.longest_mm) ** target.exponent
        waves.append((rad_mm * math.cos(angle_rad), rad_mm * math.sin(angle_rad), 2.0 * math.pi * phase, height))
    rms = math.sqrt(0.5 * math.fsum([height * height for _, _, _, height in waves]))
    return [(x, y, phase_rad, height / rms * target.rms_um) for x, y, phase_rad, height in waves]


def _uniform(seed: int, count: int) -> list[float]:
    """Return numbers in 0 .. 1, below 1, by SplitMix64 (Steele, Lea and Flood 2014): exact integer arithmetic."""
    state, numbers = seed & _MASK, list[float]()
    for _ in range(count):
        state = (state + 0x9E3779B97F4A7C15) & _MASK
        mixed = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & _MASK
        numbers.append(((mixed ^ (mixed >> 31)) >> 11) * 2.0**-53)
    return numbers

"""An image of amplitudes or of frictions."""

from __future__ import annotations

from msgspec.structs import replace

from hapticd_contract.contents import LevelMap

from ...friction import FrictionCurve
from .texture import AmplitudeAt, Detail, Texture, TexturePlate


def _amplitude(image: LevelMap, plate: TexturePlate) -> AmplitudeAt:
    if image.friction is None:
        return _image(image, plate.size_mm)
    low, high = image.friction
    frictions = [low + (high - low) * level / 255.0 for level in range(256)]
    levels_um = [min(plate.curve.amplitude_um(friction), plate.w_limit_um) for friction in frictions]
    return _looked_up(_image(replace(image, low_um=0.0, high_um=255.0), plate.size_mm), levels_um)


def _looked_up(level_of: AmplitudeAt, levels_um: list[float]) -> AmplitudeAt:
    """Amplitudes of an image's 256 levels: bilinear in friction, which the curve turned into amplitude."""

    def amplitude_um(x_mm: float, y_mm: float) -> float:
        level = level_of(x_mm, y_mm)
        below = min(int(level), 254)
        share = level - below
        return levels_um[below] * (1.0 - share) + levels_um[below + 1] * share

    return amplitude_um


def _image(image: LevelMap, plate_size_mm: tuple[float, float]) -> AmplitudeAt:
    """Bilinear between pixel centres; the outermost lie on the plate's edges and reach beyond them."""
    width, height, levels = image.width, image.height, image.levels
    last_column, last_row = float(width - 1), float(height - 1)
    left_mm, top_mm = -0.5 * plate_size_mm[0], 0.5 * plate_size_mm[1]
    columns_per_mm, rows_per_mm = last_column / plate_size_mm[0], last_row / plate_size_mm[1]
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


def _detail(image: LevelMap, size_mm: tuple[float, float]) -> Detail:
    return Detail(min(size_mm[0] / max(image.width - 1, 1), size_mm[1] / max(image.height - 1, 1)), False)


def _highest_um(image: LevelMap, curve: FrictionCurve) -> float:
    return max(image.amplitudes_um) if image.friction is None else curve.amplitude_um(min(image.friction))


TEXTURE = Texture(
    LevelMap,
    amplitude=_amplitude,
    detail=_detail,
    highest_um=_highest_um,
    asks_for_friction=lambda image: image.friction is not None,
    fills_shape=True,
)

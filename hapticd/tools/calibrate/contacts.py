"""The scale of a pad's ellipses: the affine law from the axes that it reports to those of contacts of known size.

Pure. A contact's size is known from its print: an inked fingertip on paper.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...errors import CalibrationError

LEAST_PRINT_MM, MOST_PRINT_MM = 4.0, 20.0
LEAST_SPREAD_MM = 3.0  # of true axes: less tells no offset from the scale
SCALE = (0.2, 4.0)
MOST_OFFSET_MM = 20.0

Axes = tuple[float, float]  # length and width, whole


@dataclass(frozen=True, slots=True)
class ScaleFit:
    """A true axis is `scale` times the reported one plus `offset_mm`; `residual_mm` (2N,) is what is left."""

    scale: float
    offset_mm: float
    residual_mm: npt.NDArray[np.float64]

    @property
    def rms_mm(self) -> float:
        return float(np.sqrt((self.residual_mm**2).mean()))


def parse_prints(text: str, touches: int) -> list[Axes]:
    """Parse the contacts' sizes "LxW LxW ..." in mm, one for each touch or one for all. Raises CalibrationError."""
    try:
        prints = [(float(length), float(width)) for length, width in (one.split("x") for one in text.split())]
    except ValueError:
        raise CalibrationError(f"--prints is {text!r}: write each as LxW, with blanks between them.") from None
    if not all(LEAST_PRINT_MM <= axis_mm <= MOST_PRINT_MM for one in prints for axis_mm in one):
        raise CalibrationError(f"--prints is {text!r}: give {LEAST_PRINT_MM:g} to {MOST_PRINT_MM:g} mm.")
    if len(prints) not in (0, 1, touches):
        raise CalibrationError(f"--prints has {len(prints)} prints: give one, or one for each of the {touches} marks.")
    return prints * touches if len(prints) == 1 else prints


def mean_axes_mm(ellipses: npt.ArrayLike) -> Axes:
    """Return the axes of the mean of ellipses (N, 3): major, minor, angle. Of their matrices, because the angle of a
    round one is noise, which would make each major axis longer."""
    major_mm, minor_mm, angle_rad = np.asarray(ellipses, np.float64).T
    half_mm = 0.5 * np.hypot(*(((major_mm - minor_mm) * part(2.0 * angle_rad)).mean() for part in (np.cos, np.sin)))
    middle_mm = 0.5 * (major_mm + minor_mm).mean()
    return float(middle_mm + half_mm), float(middle_mm - half_mm)


def fit_scale(reported_mm: Sequence[Axes], prints_mm: Sequence[Axes]) -> ScaleFit:
    """Fit the law to reported axes (N, 2) of contacts of these sizes (N, 2); without an offset where sizes are alike.

    Raises CalibrationError for a pad that reports no ellipse, or no such one.
    """
    reported = np.array([sorted(axes, reverse=True) for axes in reported_mm], np.float64).ravel()
    true = np.array([sorted(axes, reverse=True) for axes in prints_mm], np.float64).ravel()
    if not (np.isfinite(reported).all() and (reported > 0.0).all()):
        raise CalibrationError("The pad reports no ellipses: leave out --prints.")
    has_offset = np.ptp(true) >= LEAST_SPREAD_MM
    design = np.column_stack((reported, np.ones_like(reported)) if has_offset else (reported,))
    scale, offset_mm = [*np.linalg.lstsq(design, true, rcond=None)[0].tolist(), 0.0][:2]
    if not (SCALE[0] <= scale <= SCALE[1] and math.fabs(offset_mm) <= MOST_OFFSET_MM):
        raise CalibrationError(
            f"The pad's ellipses do not grow with the prints (scale {scale:.2f}, offset {offset_mm:.1f} mm): touch "
            "again, as firmly as for each print."
        )
    return ScaleFit(scale, offset_mm, true - scale * reported - offset_mm)

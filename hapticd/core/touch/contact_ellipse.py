"""The ellipse of a finger's contact, from the one that the pad reports: its true size, without the pad's noise.

A pad's millimetres of an ellipse are of unknown scale. One affine law, calibrated once (`hapticd calibrate trackpad`),
gives the true axis of what is reported. An ellipse is kept as the symmetric matrix that makes it of the unit disc,
(xx xy; xy yy), whose eigenvalues are its semi-axes: it is continuous in axes and angle, also where the axes are equal
and the angle is noise.

It follows the average of the newest reports with a play of PLAY_MM, which takes most of the noise: it moves
continuously, and under a finger that only rests it stays as it is to the last bit, so that the last reference holds.
"""

from __future__ import annotations

import math
from typing import Final

from ..plate.contact import ContactEllipse

LEAST_MM: Final = 3.0  # semi-axes of a fingertip's contact; what is reported beyond is a palm, or two fingers merged
MOST_MM: Final = 8.0
SIZE_SHARE: Final = 0.5  # of a report in the average size, which follows a finger that presses harder
TURN_SHARE: Final = 0.1  # and in the elongation, whose angle comes in steps of 22.5 degrees
PLAY_MM: Final = 0.3
FARTHEST_RAD: Final = 1e6  # an angle beyond is none


class EllipseScale:
    """The law of a pad's ellipses: a true axis is `scale` times the reported one, plus `offset_mm`."""

    def __init__(self, scale: float, offset_mm: float) -> None:
        self.scale: Final = scale
        self.offset_mm: Final = offset_mm

    def semi_axis_mm(self, axis_mm: float) -> float:
        """Return half the true axis, between LEAST_MM and MOST_MM."""
        semi_mm = 0.5 * (self.scale * axis_mm + self.offset_mm)
        return MOST_MM if semi_mm > MOST_MM else (semi_mm if semi_mm > LEAST_MM else LEAST_MM)


class ContactTracker:
    """The `ellipse` of one finger's contact, while it is down; None until the pad has reported one."""

    def __init__(self, scale: EllipseScale) -> None:
        self.ellipse: ContactEllipse | None = None
        self._scale: Final = scale
        self._reports = 0.0
        self._mean_mm = self._along_mm = self._across_mm = 0.0
        self._shown = (0.0, 0.0, 0.0)

    def update(self, major_mm: float, minor_mm: float, angle_rad: float) -> None:
        """Take the axes that the pad reports, and the angle of the major one. What is no ellipse is ignored."""
        if not (major_mm > 0.0 and minor_mm > 0.0):  # False for NaN
            return
        semi_mm, other_mm = self._scale.semi_axis_mm(major_mm), self._scale.semi_axis_mm(minor_mm)
        mean_mm, half_mm = 0.5 * (semi_mm + other_mm), 0.5 * (semi_mm - other_mm)
        if not abs(angle_rad) <= FARTHEST_RAD:
            angle_rad = half_mm = 0.0
        self._reports = self._reports + 1.0
        newest = 1.0 / self._reports
        size_share, turn_share = max(newest, SIZE_SHARE), max(newest, TURN_SHARE)
        self._mean_mm += size_share * (mean_mm - self._mean_mm)
        self._along_mm += turn_share * (half_mm * math.cos(2.0 * angle_rad) - self._along_mm)
        self._across_mm += turn_share * (half_mm * math.sin(2.0 * angle_rad) - self._across_mm)
        long_mm = math.sqrt(self._along_mm * self._along_mm + self._across_mm * self._across_mm)
        most_mm = min(self._mean_mm - LEAST_MM, MOST_MM - self._mean_mm)  # the size may have moved faster
        share = most_mm / long_mm if long_mm > most_mm else 1.0
        self._follow(self._mean_mm, share * self._along_mm, share * self._across_mm)

    def _follow(self, to_mean_mm: float, to_along_mm: float, to_across_mm: float) -> None:
        """Move what is shown towards the average until it is PLAY_MM away."""
        mean_mm, along_mm, across_mm = self._shown
        d_mean, d_along, d_across = to_mean_mm - mean_mm, to_along_mm - along_mm, to_across_mm - across_mm
        away_mm = math.sqrt(d_mean * d_mean + d_along * d_along + d_across * d_across)
        if self.ellipse is None:
            share = 1.0
        elif away_mm <= PLAY_MM:
            return
        else:
            share = 1.0 - PLAY_MM / away_mm
        mean_mm += share * d_mean
        along_mm += share * d_along
        across_mm += share * d_across
        self._shown = (mean_mm, along_mm, across_mm)
        self.ellipse = (mean_mm + along_mm, across_mm, mean_mm - along_mm)


def axes(ellipse: ContactEllipse) -> tuple[float, float, float]:
    """Return the whole axes of an ellipse in mm, the longer one first, and the angle of that to x in rad."""
    xx_mm, xy_mm, yy_mm = ellipse
    along_mm = 0.5 * (xx_mm - yy_mm)
    half_mm = math.hypot(along_mm, xy_mm)
    return xx_mm + yy_mm + 2.0 * half_mm, xx_mm + yy_mm - 2.0 * half_mm, 0.5 * math.atan2(xy_mm, along_mm)

"""Sizes of contacts that touches show, and how much is adopted of them: half first, all once they are found again."""

from __future__ import annotations

import math
from typing import NamedTuple

from ..config.sections import Config
from ..core.touch.contact_form import LEAST_MM, MOST_MM
from .adoption import FIRST_SHARE
from .settings import pipeline_settings

ALIKE_MM = 0.6  # of a radius: one sigma of what the fit may err by (`design.touch.contacts`)
FARTHEST_SCALE, FARTHEST_OFFSET_MM = 4.0, 2.0 * MOST_MM  # of the pad's ellipses


class AdoptedSizes(NamedTuple):
    """Arguments of `Machine.adopt_contacts`: the radius of a contact of which the pad reports no form, and the law of
    its ellipses; `ellipse_scale` 0 where they are not used."""

    radius_mm: float
    ellipse_scale: float = 0.0
    ellipse_offset_mm: float = 0.0

    @property
    def is_plausible(self) -> bool:
        """Whether fingers can have them."""
        is_radius = LEAST_MM < self.radius_mm < MOST_MM
        is_law = 0.0 <= self.ellipse_scale <= FARTHEST_SCALE and abs(self.ellipse_offset_mm) <= FARTHEST_OFFSET_MM
        return is_radius and is_law  # False for NaN

    def part(self, share: float, configured: AdoptedSizes) -> AdoptedSizes:
        """Return the sizes so far on the way from the configured ones. Without a law of ellipses theirs stays."""
        left = 1.0 - share
        radius_mm = left * configured.radius_mm + share * self.radius_mm
        if self.ellipse_scale == 0.0:
            return configured._replace(radius_mm=radius_mm)
        before_scale, before_mm = configured._law
        scale = left * before_scale + share * self.ellipse_scale
        return AdoptedSizes(radius_mm, scale, left * before_mm + share * self.ellipse_offset_mm)

    @property
    def _law(self) -> tuple[float, float]:
        """Scale and offset of an axis; those of a disc whatever is reported."""
        return (self.ellipse_scale, self.ellipse_offset_mm) if self.ellipse_scale > 0.0 else (0.0, 2.0 * self.radius_mm)


class SizesAdoption:
    """What is adopted of the sizes that verdicts find."""

    def __init__(self, config: Config) -> None:
        settings = pipeline_settings(config)
        self._configured = AdoptedSizes(settings.contact_radius_mm, settings.ellipse_scale, settings.ellipse_offset_mm)
        self._found: AdoptedSizes | None = None  # last
        self.now: AdoptedSizes | None = None  # None: as configured from the start
        self.is_due = False  # it waits for the fingers to lift

    def allows(self, found: AdoptedSizes) -> bool:
        """Whether fingers count as contacts, and can have these sizes."""
        return self._configured.radius_mm > 0.0 and found.is_plausible

    def take(self, found: AdoptedSizes) -> None:
        """Begin to adopt what a verdict found."""
        before, self._found = self._found, found
        is_found_again = before is not None and math.fabs(before.radius_mm - found.radius_mm) <= ALIKE_MM
        self._move(found.part(1.0 if is_found_again else FIRST_SHARE, self._configured))

    def take_back(self) -> None:
        """Return to what is configured."""
        self._found = None
        if self.now is not None:
            self._move(self._configured)

    def _move(self, to: AdoptedSizes) -> None:
        self.is_due = self.is_due or to != self.now
        self.now = to

    def report(self) -> dict[str, float] | None:
        """For `status`: None while they are as configured."""
        return None if self.now in (None, self._configured) or self.is_due else self.now._asdict()

"""The friction curve of a running service, from its reply to `plate`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..core.friction import DEFAULT_FRICTION_CURVE, FrictionCurve


def served_curve(body: Mapping[str, Any]) -> FrictionCurve:
    """Return the curve of the reply to `plate`; an older daemon sends none."""
    knots = body.get("friction_curve")
    if not knots:
        return DEFAULT_FRICTION_CURVE
    floor = float(knots[-1][1])
    return FrictionCurve(tuple([((friction - floor) / (1.0 - floor), um) for um, friction in knots[::-1]]), floor)

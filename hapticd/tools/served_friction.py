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
    shares = [(float(friction) - floor) / (1.0 - floor) for _, friction in knots]
    amplitudes_um = [float(amplitude_um) for amplitude_um, _ in knots]
    inner = list(zip(shares[1:-1], amplitudes_um[1:-1], strict=True))[::-1]
    return FrictionCurve(((0.0, amplitudes_um[-1]), *inner, (1.0, 0.0)), floor)

"""Time from a finger's landing to its amplitude: on a surface, and with a client that sees the finger first."""

from __future__ import annotations

from ..sim import landing
from .tables import Row, Table


def run(landings: int = landing.LANDINGS) -> Table:
    """Measure the same landings by both ways."""
    found = landing.measure(landings)
    rows = tuple(Row(way, landing.percentiles_ms(spans_ms)) for way, spans_ms in found.items())
    return Table(
        name="landing",
        title=f"landing: first contact to {landing.REACHED_FRAC:.0%} of {landing.TARGET_UM:g} um, {landings} landings",
        default=landing.SURFACE,
        rows=rows,
        compared=("p50_ms", "p95_ms"),
        notes=("virtual time: 10 ms of sensor, 5 ms of link, the phase of the scan; the client answers at once",),
    )

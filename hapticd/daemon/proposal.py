"""What the process that calibrates found in touches: a verdict of its own, one line of JSON."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from .adoption import Correction, Evidence, PlateChange, Unknown
from .contact_sizes import AdoptedSizes

_MOST_REFUSAL_CHARACTERS = 200


class Proposal(NamedTuple):
    """What the process found: to adopt, of pad and plate unless `refusal` says why not; `load_1_s` and `sizes` in any
    case. With None for a refusal nothing was fitted: there is evidence alone.

    `map_refusal` says why the map stays as it is, `next_place` which ninth of the plate to touch next: column from the
    left and row from below, 0 .. 2. `map_sigma` is one sigma of the map found in each ninth, from the lower left on,
    rows along x, and `map_known` says where it is known best and least. `evidence` is what the newest touches say of
    what was adopted before.
    """

    refusal: str | None
    correction: Correction | None = None
    change: PlateChange | None = None
    load_1_s: complex | None = None
    map_refusal: str = ""
    next_place: tuple[int, int] | None = None
    evidence: Evidence = Evidence.NONE
    sizes: AdoptedSizes | None = None
    map_sigma: tuple[tuple[float, ...], ...] | None = None
    map_known: str = ""


def proposal_of(line: bytes) -> Proposal:
    """Return what a line of the process says.

    Raises ValueError, KeyError, TypeError, OverflowError or RecursionError for what is no verdict.
    """
    found = json.loads(line)
    if "in_force" in found and "refusal" not in found:
        return Proposal(None, evidence=Evidence(found["in_force"]))
    refusal = str(found["refusal"])[:_MOST_REFUSAL_CHARACTERS]
    map_refusal = str(found.get("map_refusal", ""))[:_MOST_REFUSAL_CHARACTERS]
    load_1_s = complex(*map(float, found["load_1_s"])) if "load_1_s" in found else None
    next_place = None
    if "next_place" in found:
        column, row = (min(max(int(place), 0), 2) for place in found["next_place"])
        next_place = column, row
    evidence = Evidence(found.get("in_force", ""))
    sizes = AdoptedSizes(*map(float, found["contacts"])) if "contacts" in found else None
    if refusal:
        return Proposal(refusal, None, None, load_1_s, map_refusal, next_place, evidence, sizes)
    xx, xy, yx, yy = map(float, found["matrix"])
    x_mm, y_mm = map(float, found["offset_mm"])
    latency_s = float(found["latency_s"])
    change = None
    if "shapes" in found:
        shapes, steepest_1_mm = base64.b64decode(found["shapes"], validate=True), float(found["steepest_1_mm"])
        d, q = (tuple(map(float, found[part])) for part in "dq")
        change = PlateChange(shapes, steepest_1_mm, d, q, _unknown(found))
    if not all(map(math.isfinite, (xx, xy, yx, yy, x_mm, y_mm, latency_s))):
        raise ValueError("a correction is finite")
    correction = Correction((xx, xy, yx, yy), (x_mm, y_mm), latency_s)
    sigma = None if "map_sigma" not in found else _ninths(found["map_sigma"])
    known = str(found.get("map_known", ""))[:_MOST_REFUSAL_CHARACTERS]
    return Proposal("", correction, change, load_1_s, map_refusal, next_place, evidence, sizes, sigma, known)


def _unknown(found: Mapping[str, Any]) -> Unknown:
    """Return finite numbers. Raises ValueError, KeyError or TypeError for anything else."""
    map_frac, sensors_frac = float(found["touched_map_frac"]), float(found["sensors_frac"])
    left_mm, lower_mm, right_mm, upper_mm = map(float, found["touched_mm"])
    touched_mm = left_mm, lower_mm, right_mm, upper_mm
    if not all(map(math.isfinite, (map_frac, sensors_frac, *touched_mm))):
        raise ValueError("what is not known is finite")
    return Unknown(map_frac, touched_mm, sensors_frac)


def _ninths(rows: object) -> tuple[tuple[float, ...], ...]:
    """Return finite numbers of three rows and columns. Raises ValueError or TypeError for anything else."""
    first, second, third = (tuple(map(float, row)) for row in rows)  # type: ignore[attr-defined]
    if {len(first), len(second), len(third)} != {3} or not all(map(math.isfinite, first + second + third)):
        raise ValueError("a sigma for each ninth is finite")
    return first, second, third

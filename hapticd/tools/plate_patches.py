"""`hapticd plate --contacts --place`: where patches and sensors go, what they weigh on the design, and the stamps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..design.contact_search import ContactDesign, Drive, best_near
from ..design.glued_plate import Patch
from ..design.patch_places import PatchSet, place_patches
from ..design.stamps import Stamp, four_stamps, least_moved

STAMP_MM = 2.0  # radius


@dataclass(frozen=True, slots=True)
class Placement:
    """A patch and a sensor per mode, four stamps, and the design with all patches glued on, None without its modes."""

    drive: PatchSet
    sense: PatchSet
    stamps: tuple[Stamp, ...]
    glued: ContactDesign | None


def place(design: ContactDesign, drive: Drive, dimensions_mm: tuple[float, float, float]) -> Placement:
    """Place patches of `dimensions_mm` (width, depth, thickness) on the design's plate. Raises ValueError."""
    width_mm, depth_mm, thickness_mm = dimensions_mm
    driving, sensing = place_patches(design.shapes, (width_mm, depth_mm))
    places_mm = np.concatenate([driving.places_mm, sensing.places_mm]).tolist()
    patches = tuple(Patch(x_mm, y_mm, (width_mm, depth_mm), thickness_mm) for x_mm, y_mm in places_mm)
    plate = replace(design.plate, patches=(*design.plate.patches, *patches))
    stamps = four_stamps(least_moved(design.shapes, STAMP_MM), plate.size_mm)
    return Placement(driving, sensing, stamps, best_near(design, plate, drive))


def table(placement: Placement, design: ContactDesign) -> str:
    """Return places and couplings in columns, and a sentence on the glued plate."""
    names = [shape.name for shape in design.shapes]
    lines = [f"along the edges    x mm    y mm  {'  '.join(f'{name:>10}' for name in names)}  of each mode's best"]
    for kind, patches in (("patch", placement.drive), ("sensor", placement.sense)):
        for index, (place_mm, coupling) in enumerate(zip(patches.places_mm, patches.coupling.T, strict=True), 1):
            shares = "  ".join(f"{share:>+10.2f}" for share in coupling)
            lines.append(f"{kind + ' ' + str(index):<15} {place_mm[0]:7.2f} {place_mm[1]:7.2f}  {shares}")
    for index, stamp in enumerate(placement.stamps, 1):
        lines.append(
            f"{'stamp ' + str(index):<15} {stamp.x_mm:7.2f} {stamp.y_mm:7.2f}  "
            f"moved by {stamp.moved_frac:.2f} of all modes' amplitude"
        )
    conditions = f"Condition {placement.drive.condition:.2f} of the drive matrix, {placement.sense.condition:.2f} of"
    glued = placement.glued
    after = (
        "with all glued on, no drive has enough modes"
        if glued is None
        else f"with all glued on, the best drive is {glued.drive_hz:.0f} Hz, the static contrast "
        f"{glued.contrast:.1f}, the slip {glued.slip_um:.2f} um"
    )
    return "\n".join((*lines, f"{conditions} the sense matrix; {after}."))


def as_json(placement: Placement) -> dict[str, Any]:
    """Return the placement for --json; couplings are rows per mode."""
    return {
        **{
            name: {"places_mm": one.places_mm.tolist(), "coupling": one.coupling.tolist(), "condition": one.condition}
            for name, one in (("drive", placement.drive), ("sense", placement.sense))
        },
        "stamps": [stamp._asdict() for stamp in placement.stamps],
        "glued": None
        if placement.glued is None
        else {name: getattr(placement.glued, name) for name in ("drive_hz", "frequency_hz", "contrast", "slip_um")},
    }

"""`hapticd plate --felt`: where sensors and stamps go besides the patches, and the picture of all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..design.felt_search import FeltDesign
from ..design.glued_plate import Patch
from ..design.patch_places import PatchSet, Stamp, four_stamps, place_patches
from ..design.patch_reach import charge_nc_um
from ..values import FloatArray
from . import plotting

STAMP_MM = 2.0  # radius
SENSOR_MM = 3.0, 3.0  # which weighs an eleventh of a 10 x 10 patch
SENSOR_THICKNESS_MM = 0.3
CELL_IN = 2.9  # of a mode's picture
MARKS = (("s", "patch"), ("D", "sensor"), ("x", "stamp"))


@dataclass(frozen=True, slots=True)
class Placement:
    """A sensor per mode, what 1 um of each mode (M,) brings to each sensor (M,) in nC, and four stamps."""

    sensors: PatchSet
    charge_nc: FloatArray
    stamps: tuple[Stamp, ...]


def place(design: FeltDesign) -> Placement:
    """Place sensors along the edges, not over the patches, and stamps where all modes move them least."""
    plate = design.plate
    height_mm = (plate.thickness_mm + SENSOR_THICKNESS_MM) / 2.0
    sensors = place_patches(design.shapes, SENSOR_MM, height_mm, plate.patches)
    glued = [Patch(x_mm, y_mm, SENSOR_MM, SENSOR_THICKNESS_MM) for x_mm, y_mm in sensors.places_mm.tolist()]
    charge_nc = charge_nc_um(plate.thickness_mm, glued, design.shapes)
    return Placement(sensors, charge_nc, four_stamps(design.shapes, STAMP_MM))


def table(placement: Placement, design: FeltDesign) -> str:
    """Return places and couplings in columns."""
    sensors = placement.sensors
    names = "  ".join(f"{shape.name:>10}" for shape in design.shapes)
    lines = ["", f"             x mm    y mm  {names}  of each mode's best; condition {sensors.condition:.2f}"]
    for index, ((x_mm, y_mm), coupling) in enumerate(zip(sensors.places_mm, sensors.coupling.T, strict=True), 1):
        shares = "  ".join(f"{share:>+10.2f}" for share in coupling)
        lines.append(f"sensor {index:<3} {x_mm:7.2f} {y_mm:7.2f}  {shares}")
    for index, (x_mm, y_mm, moved_frac) in enumerate(placement.stamps, 1):
        lines.append(f"stamp {index:<4} {x_mm:7.2f} {y_mm:7.2f}  moved by {moved_frac:.2f} of all modes' amplitude")
    best_nc = placement.charge_nc.max(axis=1)
    lines.append(
        f"Sensors of {SENSOR_MM[0]:g} x {SENSOR_MM[1]:g} x {SENSOR_THICKNESS_MM:g} mm: the best gives "
        f"{best_nc.min():.1f} .. {best_nc.max():.1f} nC peak per um of a mode."
    )
    return "\n".join(lines)


def as_json(placement: Placement) -> dict[str, Any]:
    """Return the placement for --json; couplings are rows per mode."""
    sensors = placement.sensors
    return {
        "sensors": {
            "places_mm": sensors.places_mm.tolist(),
            "coupling": sensors.coupling.tolist(),
            "condition": sensors.condition,
            "charge_nc_um": placement.charge_nc.tolist(),
        },
        "stamps": [stamp._asdict() for stamp in placement.stamps],
    }


def draw(design: FeltDesign, placement: Placement, path: Path) -> None:
    """Draw each mode with patches, sensors and stamps. Raises HapticdError."""
    from matplotlib.ticker import MaxNLocator

    size_mm, count = design.plate.size_mm, len(design.shapes)
    columns = math.ceil(count / 2)
    high_in = CELL_IN * min(size_mm[1] / size_mm[0], 2.0)
    figure, axes = plotting.subplots(
        (CELL_IN + 0.2) * columns + 0.4, 2.0 * (high_in + 0.4) + 1.5, 2, columns, sharex=True, sharey=True
    )
    extent = (-size_mm[0] / 2, size_mm[0] / 2, -size_mm[1] / 2, size_mm[1] / 2)
    x_mm, y_mm = (np.linspace(-edge_mm / 2, edge_mm / 2, 161) for edge_mm in size_mm)
    places_mm = (
        np.array([(patch.x_mm, patch.y_mm) for patch in design.plate.patches]),
        placement.sensors.places_mm,
        np.array([stamp[:2] for stamp in placement.stamps]).reshape(-1, 2),
    )
    signed = plotting.stepped("RdBu", 20)
    for axis, (hz, shape) in zip(axes.flat, design.modes, strict=False):
        modes = axis.imshow(shape.on_grid(x_mm, y_mm), origin="lower", extent=extent, cmap=signed, vmin=-1, vmax=1)
        axis.set_title(f"{shape.name}: {hz - design.drive_hz:+.0f} Hz", fontsize=9)
        marks = [
            axis.plot(*at_mm.T, mark, markersize=6, color="black", fillstyle="none", label=name)[0]
            for at_mm, (mark, name) in zip(places_mm, MARKS, strict=True)
        ]
    for axis in axes.flat[count:]:
        axis.set_axis_off()
    for axis in axes[-1]:
        axis.set_xlabel("x, mm")
        axis.xaxis.set_major_locator(MaxNLocator(4, prune="both"))
    for axis in axes[:, 0]:
        axis.set_ylabel("y, mm")
        axis.yaxis.set_major_locator(MaxNLocator(4, prune="both"))  # labels at an edge would meet the next picture's
    figure.colorbar(
        modes, ax=axes, location="bottom", label="mode shape; its largest value is 1", shrink=0.8, aspect=50
    )
    figure.legend(handles=marks, loc="outside upper left", ncols=3, fontsize=8, frameon=False)
    plotting.save(figure, path, dpi=80, colours=96)

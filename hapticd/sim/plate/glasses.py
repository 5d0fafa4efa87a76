"""Glass plates of the simulation: dimensions, drive, and the modes near it in the order of their amplifiers.

reference   the paper's plate: 137.5 x 137.5 x 2 mm. Its X and Y, at the frequency that was measured, are driven; the
            next pair is 115 Hz below them.
fingertip   190 x 190 x 3 mm: four modes of one family within 130 Hz of the drive, the next one 624 Hz away, so that a
            whole fingertip can be still, by four patches of 20 x 10 x 0.5 mm.
wide        210 x 210 x 3 mm, for friction that is felt as asked, and for two hands: eight modes within 143 Hz of the
            drive, the next one 463 Hz away, by eight patches of 20 x 10 x 0.5 mm.

Patches are glued along the edges: modes are those with their mass and stiffness, and the reach is theirs, at 150 V
(`hapticd plate --felt`).

Another is read from a TOML file, as `hapticd plate --felt --glass F.toml` writes it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec

from hapticd.config.sections import LEAST_MODES, MOST_MODES
from hapticd.errors import ConfigError, SimulationError
from hapticd.formats.toml_file import read_table, shown

if TYPE_CHECKING:
    from hapticd.design.glued_plate import GluedPlate

LEAST_PARASITIC = 2  # modes near the drive that no amplifier drives
SUFFIX = ".toml"  # of a file that describes a plate
COPY = "#"  # between a plate and the number of a copy
FARTHEST_HZ = 1250.0  # from the drive: where the modes of a plate of a file are sought
WRITES = "`hapticd plate --felt --glass F.toml` writes one"
DRIVE_HZ = (2000.0, 1e6)  # bounds of a file's
_Edge = Annotated[float, msgspec.Meta(ge=10.0, le=1000.0)]
_Thickness = Annotated[float, msgspec.Meta(ge=0.01, le=100.0)]
_Reach = Annotated[float, msgspec.Meta(ge=0.01, le=100.0)]
_Place = Annotated[float, msgspec.Meta(ge=-500.0, le=500.0)]
_Extent = Annotated[float, msgspec.Meta(ge=0.01, le=1000.0)]

GluedPatch = tuple[float, float, float, float, float]  # x, y, width, depth, thickness in mm


@dataclass(frozen=True, slots=True)
class Glass:
    """A free plate of glass. `modes` are named by their nodal lines (`design.mode_shape`); the first are driven.

    `reach_um` is what an amplifier reaches at resonance on the plate without fingers, in any mode or in each driven
    one; `material` is one that `design.materials` finds. `patches` count with their mass and stiffness.
    """

    size_mm: tuple[float, float]
    thickness_mm: float
    band_hz: tuple[float, float]
    drive_hz: float
    modes: tuple[str, ...]
    driven: int
    reach_um: float | tuple[float, ...]
    material: str = "glass"
    patches: tuple[GluedPatch, ...] = ()

    def mass_ratio(self, other: Glass) -> float:
        """Return this plate's mass as a share of another's: a finger damps the heavier one less."""
        from hapticd.design.materials import find_material  # late: the daemon needs plates' names, and no design

        mine, others = (
            one.size_mm[0] * one.size_mm[1] * one.thickness_mm * find_material(one.material).density_kg_m3
            for one in (self, other)
        )
        return mine / others


@dataclass(frozen=True, slots=True, kw_only=True)
class CopiedGlass(Glass):
    """A copy (`copies`), as it was `made`. `pushes` (undriven modes, driven modes): what volts on the patches that push
    a driven mode by 1 um/s do to each of the others, in um/s."""

    made: GluedPlate
    pushes: tuple[tuple[float, ...], ...]


REFERENCE, FINGERTIP, WIDE = "reference", "fingertip", "wide"
GLASSES = {
    REFERENCE: Glass(
        size_mm=(137.5, 137.5),
        thickness_mm=2.0,
        band_hz=(28000.0, 30500.0),
        drive_hz=29205.0,
        modes=("11x0", "0x11", "9x6", "6x9", "11x1-1x11", "11x1+1x11"),
        driven=2,
        reach_um=6.0,
    ),
    FINGERTIP: Glass(
        size_mm=(190.0, 190.0),
        thickness_mm=3.0,
        band_hz=(26185.8 - FARTHEST_HZ, 26185.8 + FARTHEST_HZ),
        drive_hz=26185.8,
        modes=("12x0", "1x12", "0x12", "12x1", "2x12", "11x5", "12x2", "5x11"),
        driven=4,
        reach_um=(6.378, 18.344, 16.995, 19.622),
        patches=(
            (-85.0, 17.5, 20.0, 10.0, 0.5),
            (82.5, 85.0, 10.0, 20.0, 0.5),
            (0.0, -85.0, 10.0, 20.0, 0.5),
            (85.0, 65.0, 20.0, 10.0, 0.5),
        ),
    ),
    WIDE: Glass(
        size_mm=(210.0, 210.0),
        thickness_mm=3.0,
        band_hz=(29333.9 - FARTHEST_HZ, 29333.9 + FARTHEST_HZ),
        drive_hz=29333.9,
        modes=("0x14", "13x5", "7x12", "12x7", "5x13", "1x14", "12x7#2", "14x0", "14x2", "2x14", "8x11", "11x8"),
        driven=8,
        reach_um=(6.158, 8.499, 11.403, 10.82, 14.648, 12.48, 12.454, 20.403),
        patches=(
            (-100.0, 92.5, 10.0, 20.0, 0.5),
            (17.5, -95.0, 10.0, 20.0, 0.5),
            (-95.0, 52.5, 20.0, 10.0, 0.5),
            (-95.0, -80.0, 20.0, 10.0, 0.5),
            (-77.5, -95.0, 10.0, 20.0, 0.5),
            (95.0, 57.5, 20.0, 10.0, 0.5),
            (95.0, -60.0, 20.0, 10.0, 0.5),
            (15.0, 95.0, 10.0, 20.0, 0.5),
        ),
    ),
}


def glued(glass: Glass) -> GluedPlate:
    """Return a plate with its patches. Raises ValueError."""
    from hapticd.design.glued_plate import GluedPlate, Patch  # late, as above
    from hapticd.design.materials import find_material

    if isinstance(glass, CopiedGlass):
        return glass.made
    patches = tuple(Patch(x_mm, y_mm, (width_mm, depth_mm), mm) for x_mm, y_mm, width_mm, depth_mm, mm in glass.patches)
    return GluedPlate(glass.size_mm, glass.thickness_mm, find_material(glass.material), patches)


@lru_cache(maxsize=4)
def _copied(drawn: Glass, number: int) -> CopiedGlass:
    from .copies import set_up  # late, as above

    return CopiedGlass(**set_up(glued(drawn), drawn.drive_hz, number))


def find_glass(name: str) -> Glass:
    """Return one of GLASSES, the plate of a file, or a copy of either. Raises SimulationError, a ValueError."""
    if name in GLASSES:
        return GLASSES[name]
    drawn, mark, number = name.rpartition(COPY)
    if mark and number.isdecimal():
        return _copied(find_glass(drawn), int(number))
    if not name.endswith(SUFFIX):
        raise SimulationError(f"there is no plate {shown(name)}: give {', '.join(GLASSES)}, or a file; {WRITES}.")
    return _of_file(name)


def most_driven(plate: str) -> int:
    """Return how many modes of a plate may have an amplifier. Raises SimulationError, a ValueError."""
    glass = find_glass(plate)
    reached = len(glass.reach_um) if isinstance(glass.reach_um, tuple) else MOST_MODES
    return min(len(glass.modes) - LEAST_PARASITIC, reached)


def driven_modes(plate: str, count: int = 0) -> int:
    """Return how many modes of a plate have an amplifier: `count`, for 0 the plate's own. Raises ValueError."""
    glass = find_glass(plate)
    if count == 0:
        return glass.driven
    most = most_driven(plate)
    if not LEAST_MODES <= count <= most:
        raise SimulationError(f"{count} modes cannot be driven on the {plate} plate: give {LEAST_MODES} to {most}.")
    return count


class _PlateFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The keys of a file."""

    size_mm: tuple[_Edge, _Edge]
    thickness_mm: _Thickness
    drive_hz: Annotated[float, msgspec.Meta(ge=DRIVE_HZ[0], le=DRIVE_HZ[1])]
    driven: Annotated[int, msgspec.Meta(ge=LEAST_MODES, le=MOST_MODES)]
    reach_um: _Reach | tuple[_Reach, ...]
    modes: tuple[str, ...]
    material: str
    patches: tuple[tuple[_Place, _Place, _Extent, _Extent, _Thickness], ...] = ()


@lru_cache(maxsize=8)
def _of_file(path: str) -> Glass:
    try:
        found = msgspec.convert(read_table(Path(path), WRITES), _PlateFile)
    except ConfigError as error:
        raise SimulationError(str(error)) from None
    except msgspec.ValidationError as error:
        raise SimulationError(f"{path}: {error}; {WRITES}.") from None
    modes, driven, reach_um = found.modes, found.driven, found.reach_um
    if len(modes) < driven + LEAST_PARASITIC or len(set(modes)) < len(modes):
        raise SimulationError(f"{path}: modes: needs {driven + LEAST_PARASITIC} or more, each once; the driven first.")
    if isinstance(reach_um, tuple) and len(reach_um) != driven:
        raise SimulationError(f"{path}: reach_um: needs one number, or one for each of {driven} driven modes.")
    _check_material(path, found.material)
    band_hz = (found.drive_hz - FARTHEST_HZ, found.drive_hz + FARTHEST_HZ)
    return Glass(band_hz=band_hz, **msgspec.structs.asdict(found))


def _check_material(path: str, name: str) -> None:
    from hapticd.design.materials import find_material  # late, as above

    try:
        of = find_material(name)
    except ValueError as error:
        raise SimulationError(f"{path}: material: {error}") from None
    if not all(0.0 < number < math.inf for number in (of.young_gpa, of.density_kg_m3)):
        raise SimulationError(f"{path}: material: {shown(name)} is no solid's GPa,Poisson,kg/m3.")

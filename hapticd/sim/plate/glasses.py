"""Glass plates of the simulation: dimensions, drive, and the modes near it in the order of their amplifiers.

reference   the paper's plate: 137.5 x 137.5 x 2 mm. Its X and Y are driven; the next pair is 84 Hz above them.
fingertip   200 x 200 x 3 mm, designed for contacts: longer waves, and four modes of different families within
            81 Hz of the drive, so that a whole fingertip can be still (`hapticd plate`).
"""

from __future__ import annotations

from dataclasses import dataclass

LEAST_PARASITIC = 2  # modes near the drive that no amplifier drives


@dataclass(frozen=True, slots=True)
class Glass:
    """A free plate of glass. `modes` are named by their nodal lines (`design.free_plate`); the first are driven.

    `reach_um` is what an amplifier reaches at resonance on the plate without fingers.
    """

    size_mm: tuple[float, float]
    thickness_mm: float
    band_hz: tuple[float, float]
    drive_hz: float
    modes: tuple[str, ...]
    driven: int
    reach_um: float

    def mass_ratio(self, other: Glass) -> float:
        """Return this plate's mass as a share of another's: a finger damps the heavier one less."""
        mine, others = (one.size_mm[0] * one.size_mm[1] * one.thickness_mm for one in (self, other))
        return mine / others


REFERENCE, FINGERTIP = "reference", "fingertip"
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
        size_mm=(200.0, 200.0),
        thickness_mm=3.0,
        band_hz=(28000.0, 30500.0),
        drive_hz=29375.0,
        modes=("13x1-1x13", "10x8-8x10", "13x0", "0x13", "10x8+8x10", "13x1+1x13", "9x9", "5x12"),
        driven=4,
        reach_um=4.23,
    ),
}


def driven_modes(plate: str, count: int = 0) -> int:
    """Return how many modes of a plate have an amplifier: `count`, for 0 the plate's own. Raises ValueError."""
    if count == 0:
        return GLASSES[plate].driven
    most = len(GLASSES[plate].modes) - LEAST_PARASITIC
    if not 2 <= count <= most:
        raise ValueError(f"{count} modes cannot be driven on the {plate} plate: give 2 to {most}.")
    return count

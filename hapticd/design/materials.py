"""Plate materials, catalogue values: a batch's modulus may be some per cent off, frequencies half of that.

Sources: EN 572-1 (float); Pilkington technical bulletin ATS-129 (pilkington); SCHOTT, BOROFLOAT 33 mechanical
properties (borosilicate); J. M. Gere, Mechanics of Materials, 5th ed., appendix H (aluminium, steel). `glass` is the
reference plate: soda-lime glass. The paper's pair of modes, measured at 29.2 kHz, is by theory at 28.1: 0.08 mm of
thickness, of which float glass is 0.2 mm off, or modulus.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Material:
    """An isotropic solid, and the source of its values."""

    young_gpa: float
    poisson: float
    density_kg_m3: float
    source: str


MATERIALS = {
    "glass": Material(72.5, 0.22, 2500.0, "the reference plate"),
    "float": Material(70.0, 0.20, 2500.0, "EN 572-1"),
    "pilkington": Material(72.0, 0.23, 2530.0, "Pilkington ATS-129"),
    "borosilicate": Material(64.0, 0.20, 2230.0, "SCHOTT BOROFLOAT 33"),
    "aluminium": Material(70.0, 0.33, 2700.0, "Gere, 6061-T6"),
    "steel": Material(200.0, 0.29, 7850.0, "Gere, structural steel"),
}


def find_material(text: str) -> Material:
    """Return one of MATERIALS by name, or parse "YOUNG_GPA,POISSON,DENSITY_KG_M3". Raises ValueError."""
    if text in MATERIALS:
        return MATERIALS[text]
    try:
        young_gpa, poisson, density_kg_m3 = map(float, text.split(","))
    except ValueError:
        raise ValueError(
            f"there is no material {text!r}; give one of {', '.join(MATERIALS)}, or GPa,Poisson,kg/m3."
        ) from None
    return Material(young_gpa, poisson, density_kg_m3, "as given")

"""Mode shapes of the simulated plate: theory's, scaled to a peak of 1 over the whole plate.

A free plate's peaks lie at its edges, so a mode at W_LIM moves far less than that where fingers are, within 10 mm of
the edge.
"""

from __future__ import annotations

from functools import lru_cache

from hapticd.design import ModeShape
from hapticd.design.free_plate import free_modes
from hapticd.design.materials import find_material
from hapticd.errors import SimulationError

from .glasses import REFERENCE, find_glass


def theory(name: str, glass: str = REFERENCE) -> tuple[float, ModeShape]:
    """Return frequency (Hz) and shape of a mode of the free plate; `glass` is a name or a file.

    A name has the nodal lines, such as "9x6". Raises SimulationError for an unknown one.
    """
    modes = _by_name(glass)
    if name not in modes:
        raise SimulationError(f"the {glass} plate has no mode {name!r} near its drive.")
    return modes[name]


@lru_cache(maxsize=4)
def _by_name(glass: str) -> dict[str, tuple[float, ModeShape]]:
    plate = find_glass(glass)
    try:
        modes = free_modes(plate.size_mm, plate.thickness_mm, find_material(plate.material), plate.band_hz)
    except ValueError as error:  # of a plate that a file describes
        raise SimulationError(f"the {glass} plate: {error}") from None
    return {shape.name: (frequency_hz, shape) for frequency_hz, shape in modes}

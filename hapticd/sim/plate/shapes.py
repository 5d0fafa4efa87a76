"""Mode shapes of the simulated plate: theory's, scaled to a peak of 1 over the whole plate.

A free plate's peaks lie at its edges, so a mode at W_LIM moves far less than that where fingers are, within 10 mm of
the edge.
"""

from __future__ import annotations

import re
from functools import lru_cache

from hapticd.design import ModeShape
from hapticd.design.mode_shape import distinct_names
from hapticd.errors import SimulationError

from . import stored
from .glasses import REFERENCE, Glass, find_glass, glued


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
    frequencies_hz, coefficients = stored.find("Hz", plate), stored.find("shapes", plate)
    if frequencies_hz is None or coefficients is None:
        try:
            return computed(plate)
        except ValueError as error:  # of a plate that a file describes
            raise SimulationError(f"the {glass} plate: {error}") from None
    found = zip(plate.modes, frequencies_hz.tolist(), coefficients, strict=True)
    return {name: (hz, ModeShape(plate.size_mm, of, _lines(name), name)) for name, hz, of in found}


def computed(plate: Glass) -> dict[str, tuple[float, ModeShape]]:
    """Return all modes of a plate near its drive, by theory. Raises ValueError."""
    modes = glued(plate).modes(plate.band_hz)
    return dict(zip(distinct_names(modes), modes, strict=True))


def _lines(name: str) -> tuple[int, int]:
    across, along = re.findall(r"\d+", name)[:2]
    return int(across), int(along)

"""Plate design: free-plate theory, fits of measured mode maps, maps of felt friction, resonance and drive."""

from .cartography import CartographyFit, fit_cartography, fit_scan
from .free_fit import nearest_free_modes
from .free_plate import ModeShape, free_plate_modes
from .pose import Pose
from .scan import sample_cartography, sample_scan

__all__ = [
    "CartographyFit",
    "ModeShape",
    "Pose",
    "fit_cartography",
    "fit_scan",
    "free_plate_modes",
    "nearest_free_modes",
    "sample_cartography",
    "sample_scan",
]

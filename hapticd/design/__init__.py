"""Plate design: free-plate theory, fits of measured mode maps, maps of felt friction, resonance and drive."""

from .cartography import CartographyFit, fit_scan
from .free_fit import Pose, nearest_free_modes
from .glued_plate import free_plate_modes, plate_modes
from .mode_shape import ModeShape
from .scan import sample_cartography, sample_scan

__all__ = [
    "CartographyFit",
    "ModeShape",
    "Pose",
    "fit_scan",
    "free_plate_modes",
    "nearest_free_modes",
    "plate_modes",
    "sample_cartography",
    "sample_scan",
]

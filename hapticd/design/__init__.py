"""What a plate's mode shapes are: free-plate theory, and the fit of a measured cartography."""

from .cartography import CartographyFit, fit_cartography, sample_cartography
from .free_plate import ModeShape, free_plate_modes

__all__ = ["CartographyFit", "ModeShape", "fit_cartography", "free_plate_modes", "sample_cartography"]

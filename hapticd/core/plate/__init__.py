"""The plate as measured: driven mode shapes as splines, contact averages, and the parasitic (undriven) modes."""

from .mode_shapes import ModeShapes

__all__ = ["ModeShapes"]

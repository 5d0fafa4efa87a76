"""The configuration: every key with its meaning and bounds, and the TOML file that sets some of them."""

from .loader import load
from .sections import SIMULATED, Config

__all__ = ["SIMULATED", "Config", "load"]

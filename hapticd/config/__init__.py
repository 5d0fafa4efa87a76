"""The configuration: all keys with defaults, bounds and meanings, and the loader of the TOML file."""

from .loader import load
from .sections import SIMULATED, Config

__all__ = ["SIMULATED", "Config", "load"]

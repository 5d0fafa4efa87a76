"""The configuration: all keys with defaults, bounds and meanings, and the loader of the TOML file."""

from .sections import Config

__all__ = ["Config"]

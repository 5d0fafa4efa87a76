"""Formats that the core and the configuration read too: TOML with bounds, NPZ, mode maps."""

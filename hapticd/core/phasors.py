"""Modal amplitudes: their type."""

Phasors = tuple[complex, ...]  # modal amplitudes (M,) in um

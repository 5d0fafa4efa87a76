"""Modal amplitudes and mode shapes: their types."""

Phasors = tuple[complex, ...]  # modal amplitudes (M,) in um
ModeRow = tuple[float, ...]  # shapes of all modes at one finger, or real modal amplitudes
ModeRows = tuple[ModeRow, ...]

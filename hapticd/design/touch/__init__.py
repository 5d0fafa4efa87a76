"""Self-calibration: pad, sensors and mode map from what fingers do to a driven plate."""

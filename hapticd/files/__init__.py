"""File formats: mode maps, calibrations, configuration syntax, recordings, and where outputs may be written."""

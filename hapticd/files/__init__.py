"""File formats: mode maps, calibrations, TOML, recordings; pictures; and checks of output paths."""

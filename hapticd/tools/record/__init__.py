"""`hapticd record`, `replay` and `export`."""

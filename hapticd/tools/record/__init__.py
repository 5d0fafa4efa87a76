"""`hapticd record`, `replay`, `export` and `plot`."""

"""Benchmarks of what is still open: error against run time for each part of the path."""

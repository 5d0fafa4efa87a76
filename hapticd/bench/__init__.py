"""The benchmarks behind `hapticd bench`: error against run time."""

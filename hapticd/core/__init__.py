"""The pure core: numbers in, numbers out; no clock, socket, file or log. Read `pipeline.py` from top to bottom."""

"""Encoding and decoding without I/O: trackpad reports, board frames, client messages."""

"""Bytes to values and back, without I/O: trackpad reports, board frames, client messages."""

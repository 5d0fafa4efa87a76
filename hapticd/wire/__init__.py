"""Bytes to values and back. Sans-I/O: nothing here opens, waits or decides."""

"""Recordings: everything that the daemon receives and decides, in one file."""

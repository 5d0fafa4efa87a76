"""Recordings: all that a machine heard, wrote and decided, in one file that explains itself. See README.md here."""

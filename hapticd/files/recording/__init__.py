"""Recordings: all inputs, outputs and decisions of the daemon, as MCAP files."""

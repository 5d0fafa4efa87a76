"""`hapticd stream`: a running daemon's states and metrics in the formats of other programs.

Each stream is a process of its own and a client of the daemon, which needs no code for it.
"""

"""`hapticd stream`: a running daemon's states in the format of another program.

It is a process of its own and a client of the daemon, which needs no code for it.
"""

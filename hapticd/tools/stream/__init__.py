"""`hapticd stream`: what a running daemon tells, in forms that other programs already read.

Each is a process of its own and one more client of the daemon: nothing in the daemon knows of it, and nothing of it
lies on the path of a touch.
"""

"""`hapticd doctor`: checks of everything that the service needs; each passes, warns or fails, and prints its fix.

Nothing is changed or kept open. If no daemon runs, the trackpad is read for two seconds, and the board's handshake is
requested.
"""

"""The service that `hapticd run` starts: the core wired to trackpad, board and clients, and its life as a process."""

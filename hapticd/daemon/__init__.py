"""What `hapticd run` is: the core wired to trackpad, board and clients, and its life as a process."""

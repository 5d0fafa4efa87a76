"""The thin rim: moves bytes between devices, sockets and the daemon, and decides nothing."""

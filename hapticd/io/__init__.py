"""The thin rim: devices, sockets, the operating system. Moves bytes and decides nothing."""

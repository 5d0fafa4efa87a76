"""Input and output: devices, client sockets and operating-system services. Moves bytes and decides nothing."""

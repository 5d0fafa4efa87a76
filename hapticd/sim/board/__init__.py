"""The simulated board: the firmware's own C on the host, or its image in an emulator, and the line to it."""

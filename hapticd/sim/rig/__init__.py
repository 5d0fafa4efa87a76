"""The simulated rig in real time: a process with a board and a trackpad that the daemon opens like real devices."""

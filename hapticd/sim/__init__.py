"""The simulated plate: firmware C, plate physics and fingers, in lock-step or in real time."""

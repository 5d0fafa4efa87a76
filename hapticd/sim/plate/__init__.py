"""The simulated plate: true mode shapes, neighbouring modes, and the noisy map that the daemon gets."""

"""The simulated plate: true mode shapes, parasitic modes, and the noisy mode maps for the daemon."""

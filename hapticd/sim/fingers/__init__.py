"""Simulated fingers: paths, scenarios, targets, and the trackpad's reports of them."""

"""Simulated fingers: how they move, what they ask for, and what the trackpad reports of them."""

"""Fingers as points: signs and phases on any number of modes, with fast paths for few."""

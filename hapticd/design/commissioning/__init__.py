"""Commissioning of a rig: measured values in, verdicts with their likely causes out."""

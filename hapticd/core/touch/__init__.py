"""Trackpad frames to tracked fingers: one clock filter for the pad's stamps, and stable finger ids."""

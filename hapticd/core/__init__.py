"""The decisions: pure functions and small state, numbers in, numbers out, time as an argument."""

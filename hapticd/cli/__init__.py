"""The arguments of the commands that have no package of their own, and what they set going."""

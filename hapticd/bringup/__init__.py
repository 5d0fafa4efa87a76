"""A person at the bench and one board: what `hapticd firmware` does. The daemon needs none of it."""

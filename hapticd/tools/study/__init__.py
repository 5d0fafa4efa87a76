"""`hapticd study`: the paper's evaluation with people, from the session to the statistics."""

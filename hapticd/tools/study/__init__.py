"""`hapticd study`: the paper's evaluation with people."""

"""`hapticd study`: the paper's evaluation, as a client like any other. README.md beside this tells how it goes."""

"""`hapticd plate map`: where fingers feel the frictions that are asked of them, for given fingers or random pairs."""

"""`hapticd plate map`: where another finger can be still, or slip, for given fingers or over all pairs of places."""

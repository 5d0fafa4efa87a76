"""`hapticd plate map`: where fingers feel the frictions that are asked of them, while others are elsewhere."""

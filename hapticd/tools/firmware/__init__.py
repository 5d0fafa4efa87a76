"""`hapticd firmware`: the board at the bench, while the service is stopped."""

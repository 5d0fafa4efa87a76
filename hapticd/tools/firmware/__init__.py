"""`hapticd firmware`: commands for the board at the bench, while the service is stopped."""

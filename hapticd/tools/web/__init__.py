"""Shared by the servers of pages and programs (view, gateway): access, connections, pacing, and JSON texts."""

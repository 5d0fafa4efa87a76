"""Shared by the servers of pages and programs (view, gateway): access, serving, a bounded rate, and JSON texts."""

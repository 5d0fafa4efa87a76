"""Shared by the servers of pages and programs (view, gateway, calibrate): access, serving, a bounded rate, and JSON
texts. Raises HapticdError without aiohttp."""

from ...errors import missing_library

try:
    import aiohttp  # noqa: F401
except ImportError:
    raise missing_library("A page or gateway needs aiohttp", "view") from None

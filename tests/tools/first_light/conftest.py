"""A real Chromium."""

from __future__ import annotations

from chromium import browser  # noqa: F401

"""A real Chromium; the viewer as a process is in `viewprocess.py`."""

from __future__ import annotations

import sys
from pathlib import Path

from chromium import browser, chromium  # noqa: F401

sys.path.insert(0, str(Path(__file__).parent))

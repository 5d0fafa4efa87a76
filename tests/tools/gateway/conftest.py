"""A daemon without a plate."""

from __future__ import annotations

import sys
from pathlib import Path

from clients.conftest import daemon  # noqa: F401

sys.path.insert(0, str(Path(__file__).parent))

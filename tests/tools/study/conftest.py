"""Puts the client library on the path, as for the clients' own tests."""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
sys.path[:0] = [str(ROOT / "clients" / "python"), str(ROOT / "tests" / "clients"), str(Path(__file__).parent)]

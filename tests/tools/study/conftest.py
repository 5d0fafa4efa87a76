"""Puts the fakes of this folder and of the clients' tests on the path."""

from __future__ import annotations

import sys
from pathlib import Path

FOLDER = Path(__file__).parent
sys.path[:0] = [str(FOLDER.parents[1] / "clients"), str(FOLDER)]

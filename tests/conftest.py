"""Helpers that several test files share lie beside them and are put on the path here."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))

# A person's run looks for new counter-examples each time; who judges a commit must come to the same answer each time.
settings.register_profile("same-each-time", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("same-each-time")

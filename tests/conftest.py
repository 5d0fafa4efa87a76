"""Helpers that several test files share lie beside them and are put on the path here."""

from __future__ import annotations

import gc
import os
import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))

# The same examples each time, so that a commit is judged the same everywhere; `make test-all` sets NEW_EXAMPLES.
settings.register_profile("same-each-time", derandomize=True)
if not os.environ.get("NEW_EXAMPLES"):
    settings.load_profile("same-each-time")


def pytest_collection_finish() -> None:
    """Keep the collected tests out of every garbage collection, which takes a third of a second with them."""
    gc.freeze()

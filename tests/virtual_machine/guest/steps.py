"""Steps in order, each with a file of what it found or of how it failed; they only look, and tests outside judge."""

from __future__ import annotations

import json
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

RESULTS = Path("/run/results")


def step(name: str, look: Callable[[], Any], log: Callable[[], str]) -> Any:
    """Run it and keep what it found, or how it failed and the log. Gives what it found, None if it failed."""
    print(f"guest: {name}", flush=True)
    found, error = None, None
    try:
        found = look()
    except Exception:
        error = f"{traceback.format_exc()}\nthe daemon said:\n{log()}"
    (RESULTS / f"{name}.json").write_text(json.dumps({"found": found, "error": error}, default=str))
    return found

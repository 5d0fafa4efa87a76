"""Version of hapticd, with the commit if it runs from a checkout."""

from __future__ import annotations

import subprocess
from pathlib import Path

from .. import __version__

CHECKOUT = Path(__file__).parents[2]
WITHIN_S = 5.0


def version_text(checkout: Path = CHECKOUT) -> str:
    """Return such as "0.1.0", "0.1.0 (commit 1f2e3d4)" or "0.1.0 (commit 1f2e3d4-dirty)", a checkout with changes."""
    if not (checkout / ".git").exists():
        return __version__
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--exclude", "*"]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=WITHIN_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return __version__
    return f"{__version__} (commit {ended.stdout.strip()})"

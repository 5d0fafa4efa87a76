"""All fuzz targets, by name."""

from __future__ import annotations

from fuzz import board, client, files, library, trackpad

TARGETS = {
    target.name: target
    for target in (trackpad.TARGET, board.TARGET, client.TARGET, library.TARGET, *files.TARGETS)
}  # fmt: skip

"""All fuzz targets, by name."""

from __future__ import annotations

from fuzz import board, client, files, gateway, library, recordings, touchscreen, tracker, trackpad

TARGETS = {
    target.name: target
    for target in (
        *(trackpad.TARGET, touchscreen.TARGET, tracker.TARGET, board.TARGET, client.TARGET, gateway.TARGET),
        library.TARGET,
        recordings.TARGET,
        *files.TARGETS,
    )
}  # fmt: skip

"""All fuzz targets, by name."""

from __future__ import annotations

from fuzz import clients, devices, files, recordings

TARGETS = {target.name: target for target in (*devices.TARGETS, *clients.TARGETS, recordings.TARGET, *files.TARGETS)}

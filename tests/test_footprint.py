"""What a running service carries in its memory, and what it leaves where it lies."""

from __future__ import annotations

import subprocess
import sys

START = """
import sys
from hapticd import __main__ as command
from hapticd.tools.run import without_openssl
with without_openssl():
    from hapticd.tools import service
from hapticd.daemon import settings
from hapticd.config.sections import Config
command.parser("run")
settings.warm_up(Config())
print(*sorted(sys.modules))
"""

NOT_NEEDED = (
    *("scipy", "matplotlib", "numpy.ma", "numpy.fft", "numpy.random", "numpy.polynomial"),
    *("hapticd.design", "hapticd.bench", "hapticd.tools.firmware", "hapticd.sim.lockstep"),
    *("hapticd.sim.plate.ground_truth", "hapticd.tools.gateway", "hapticd_study"),
    *("email", "http", "xml", "unittest", "sqlite3", "multiprocessing", "ssl", "_ssl", "_hashlib"),
    *("mcap", "lz4", "zstandard"),  # of a recording, where one is configured
    *(f"hapticd.io.devices.{pad}" for pad in ("evdev_trackpad", "tuio_trackpad", "replay")),  # another than is used
    *("statistics", "fractions", "aiohttp", "evdev", "pylsl", "pythonosc"),
)


def test_a_started_service_has_loaded_no_simulation_no_fits_and_no_tools() -> None:
    done = subprocess.run([sys.executable, "-c", START], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "hapticd.core.pipeline" in loaded
    assert not loaded & {*NOT_NEEDED}

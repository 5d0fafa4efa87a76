"""What a running service carries in its memory, and what it leaves where it lies."""

from __future__ import annotations

import subprocess
import sys

import pytest

from hapticd.__main__ import main

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
    *(
        "hapticd.design",
        "hapticd.bench",
        "hapticd.tools.firmware",
        "hapticd.sim.lockstep",
        "hapticd.sim.plate.ground_truth",
    ),
    *("email", "http", "xml", "unittest", "sqlite3", "multiprocessing", "ssl", "_ssl", "_hashlib"),
    *("mcap", "lz4", "zstandard"),  # of a recording, where one is configured
    *(
        "hapticd.io.devices.evdev_trackpad",
        "hapticd.io.devices.tuio_trackpad",
        "hapticd.io.devices.replay",
    ),  # of a pad that is another
    *(
        "statistics",
        "fractions",
        "aiohttp",
        "evdev",
        "pylsl",
        "pythonosc",
        "hapticd.tools.gateway",
        "hapticd_study",
    ),
)


def test_a_started_service_has_loaded_nothing_of_the_simulation_the_fits_and_the_tools() -> None:
    done = subprocess.run([sys.executable, "-c", START], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert "hapticd.core.pipeline" in loaded
    assert not loaded & {*NOT_NEEDED}


def test_the_first_word_alone_decides_whether_other_commands_are_known(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, word in ((["run", "--help"], "hapticd run --config"), (["--help"], "simulate")):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 0
        assert word in capsys.readouterr().out

"""Helpers that several test files share lie in their folder and are put on the path here."""

from __future__ import annotations

import gc
import os
import runpy
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).parent))
if not (Path(__file__).parents[1] / "hapticd" / "board_protocol.py").exists():  # as in a checkout of another commit
    runpy.run_path(str(Path(__file__).parents[1] / "firmware" / "make_protocol.py"))["write_module"]()

# A script that starts the tests behind `&` has Ctrl-C ignored, which all programs that they start would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples each time, so that a commit is judged the same everywhere; `make test-all` sets NEW_EXAMPLES. Each
# setting is named, because hypothesis has other defaults where CI is set, and a deadline where it is not.
settings.register_profile(
    "same-each-time",
    database=None,
    deadline=None,
    derandomize=True,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("new-each-time", settings.get_profile("same-each-time"), derandomize=False)
settings.load_profile("new-each-time" if os.environ.get("NEW_EXAMPLES") else "same-each-time")


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    """What a service manager hears: NOTIFY_SOCKET."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        yield listening


SLOWEST = {"virtual_machine", "view"}  # folders of emulated machines and browsers


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take minutes, so that none of them is left for one core at the end."""
    items.sort(key=lambda item: SLOWEST.isdisjoint(item.path.parts))


def pytest_collection_finish() -> None:
    """Keep the collected tests out of every garbage collection, which takes a third of a second with them."""
    gc.freeze()

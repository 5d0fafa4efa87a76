"""Helpers that several test files share lie in their folder and are put on the path here."""

from __future__ import annotations

import gc
import os
import re
import runpy
import shutil
import signal
import socket
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import hapticd  # noqa: F401  asks for one thread of BLAS, which counts before numpy is loaded: more would spin

sys.path.insert(0, str(Path(__file__).parent))
if not (Path(__file__).parents[1] / "hapticd" / "board_protocol.py").exists():  # as in a checkout of another commit
    runpy.run_path(str(Path(__file__).parents[1] / "firmware" / "make_protocol.py"))["write_module"]()

# A script that starts the tests behind `&` has Ctrl-C ignored, which all programs that they start would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same few examples each time, so that a commit is judged the same everywhere; `make test-all` sets NEW_EXAMPLES.
# Each setting is named, because hypothesis has other defaults where CI is set, and a deadline where it is not.
settings.register_profile(
    "same-each-time",
    database=None,
    deadline=None,
    derandomize=True,
    max_examples=40,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("new-each-time", settings.get_profile("same-each-time"), derandomize=False, max_examples=100)
settings.load_profile("new-each-time" if os.environ.get("NEW_EXAMPLES") else "same-each-time")

OF_A_CALLER = ("HAPTICD_RUNTIME_DIR", "RUNTIME_DIRECTORY", "NOTIFY_SOCKET", "WATCHDOG_USEC", "JOURNAL_STREAM")
OF_HOME = {"HOME": "", "XDG_RUNTIME_DIR": "run", "DASK_TEMPORARY_DIRECTORY": "dask"} | {
    f"XDG_{kind}_HOME": kind.lower() for kind in ("CACHE", "CONFIG", "DATA", "STATE")
}


def pytest_configure(config: pytest.Config) -> None:
    """Give the tests and all programs that they start a home and a folder for temporary files of their own.

    Its name is short, for a socket allows 107 bytes, and a flooder of another user may pass through it. What pytest
    keeps of tests that fail (tmp_path) stays where it was.
    """
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
    worker: str | None = getattr(config, "workerinput", {}).get("workerid")  # it inherits pytest-xdist's environment
    own = Path(tempfile.gettempdir(), worker) if worker else Path(tempfile.mkdtemp(prefix="hd-"))
    for name, folder in OF_HOME.items():
        path = own / "home" / folder
        path.mkdir(parents=True, exist_ok=True, mode=0o700)
        os.environ[name] = str(path)
    os.environ["MPLCONFIGDIR"] = f"{sys.prefix}/plots"  # each list of fonts takes more than a second to make
    own.chmod(0o711)
    os.environ["TMPDIR"] = tempfile.tempdir = str(own)
    for name in OF_A_CALLER:
        os.environ.pop(name, None)


def pytest_unconfigure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shutil.rmtree(os.environ["TMPDIR"])


def left_behind() -> set[Path]:
    """Temporary files, and files of hapticd in the home."""
    own = Path(os.environ["TMPDIR"])
    return {path for path in own.iterdir() if path.name != "home"} | {
        Path(folder, name)
        for folder, _, names in os.walk(own / "home")  # passes over a folder that a process removes meanwhile
        if "hapticd" in Path(folder).parts
        for name in names
    }


@pytest.fixture(scope="session", autouse=True)
def session_leaves_nothing_behind() -> Iterator[None]:
    yield
    assert left_behind() == set(), "A test or a fixture left these files"


@pytest.fixture(autouse=True)
def nothing_is_left_behind() -> Iterator[None]:
    """Fail a test that leaves files beyond its `tmp_path`: the next run, or another at the same time, finds them."""
    before = left_behind()  # those of fixtures of a module or the session
    yield
    assert left_behind() <= before, "The test left these files"


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[socket.socket]:
    """Socket of a service manager: NOTIFY_SOCKET."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.setblocking(False)
        yield listening


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of long tests alone where none runs: each worker would import their browsers and chips."""
    if not (config.option.markexpr.startswith("not long and ") and collection_path.name.startswith("test_")):
        return None
    return bool(re.search(r"^pytestmark = \[?pytest\.mark\.long", collection_path.read_text("utf-8"), re.M)) or None


SLOWEST = ("virtual_machine", "firmware", "view")  # folders of emulated machines and browsers


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take minutes, so that none of them is left for one core at the end."""
    items.sort(key=lambda item: [name not in item.path.parts for name in SLOWEST])


def pytest_collection_finish() -> None:
    """Keep the collected tests out of every garbage collection, which takes a third of a second with them."""
    gc.freeze()

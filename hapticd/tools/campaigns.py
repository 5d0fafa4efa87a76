"""Campaigns: many tasks that do not depend on each other, played by processes of this machine or by a Dask cluster.

The results are in the order of the tasks and the same to the last bit, whoever plays them and in whatever order. With
--keep each is added to a file when it comes (an SQLite database), and later calls play what is missing there. A result
counts for the same task, sources, Python and NumPy. A task whose worker is killed is repeated.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from platform import node, python_version
from typing import TYPE_CHECKING, Any, TypeVar, get_type_hints

import msgspec
import numpy as np

from .. import __version__
from ..errors import HapticdError, UsageError, missing_library
from ..regular_file import is_special
from .arguments import whole
from .progress import Progress

if TYPE_CHECKING:
    from sqlite3 import Connection

    from ..design.campaign import TaskRunner

OPTIONS = ("jobs", "cluster", "keep")
LOSSES = 3  # of workers, without a result between them, that end a campaign
CONNECT_S = 10

Task = TypeVar("Task")
Result = TypeVar("Result")
Play = Callable[[Any], Any]  # a function of a module, with annotations: from a task to its result
Keyed = dict[bytes, Any]


def add_arguments(parser: argparse._ActionsContainer, part: str = "") -> None:
    """Add --jobs, --cluster and --keep, which are None without their option; `part` says what they belong to."""
    for option, metavar, kind, text in (
        ("--jobs", "N", whole(1, 1024), "play N tasks at the same time (default: one per processor)"),
        (
            "--cluster",
            "ADDRESS",
            str,
            "play them on a Dask cluster, which can run any code here: trust it",
        ),
        ("--keep", "FILE", Path, "keep the results there for later calls, which play only what is missing"),
    ):
        parser.add_argument(option, type=kind, metavar=metavar, help=part + text)


def of(options: argparse.Namespace) -> TaskRunner:
    """Return the campaign that the command line asks for. Raises UsageError."""
    if options.jobs is not None and options.cluster is not None:
        raise UsageError("--jobs: a cluster plays as many tasks as it has workers: omit it or --cluster.")
    jobs = len(os.sched_getaffinity(0)) if options.jobs is None else options.jobs
    return partial(run, jobs=jobs, cluster=options.cluster, keep=options.keep)


def run(
    what: str,
    play: Callable[[Task], Result],
    tasks: Sequence[Task],
    /,
    *,
    jobs: int = 1,
    cluster: str | None = None,
    keep: Path | None = None,
) -> list[Result]:
    """Return each task's result; `what` stands before the bar. Raises HapticdError, and what `play` raises."""
    keys = [key_of(play, task) for task in tasks]
    by_key = dict(zip(keys, tasks, strict=True))
    with _results(keep) as database:
        found: Keyed = {}
        for key in by_key:
            found.update(database.execute("SELECT key, result FROM results WHERE key = ?", (key,)))
        missing = {key: task for key, task in by_key.items() if key not in found}
        if found:
            print(f"{what}: {len(found)} of {len(by_key)} were played before.", file=sys.stderr)
        with Progress(what) as progress, closing(_played(play, dict(missing), jobs, cluster)) as played:
            for done, (key, result) in enumerate(played, 1):
                found[key] = result
                database.execute("INSERT OR REPLACE INTO results VALUES (?, ?)", (key, result))
                progress(done / len(missing))
    return [_decoded(play, found[key]) for key in keys]


# --- workers ---


def _played(play: Play, missing: Keyed, jobs: int, cluster: str | None) -> Generator[tuple[bytes, bytes]]:
    """Yield keys and encoded results as they come; workers that are lost are replaced."""
    if cluster is None and min(jobs, len(missing)) <= 1:
        yield from ((key, encode(play(task))) for key, task in missing.items())
        return
    code, losses = code_of(play), 0
    while missing:
        with _processes(min(jobs, len(missing))) if cluster is None else _cluster(cluster) as (submit, completed, lost):
            futures = {}
            with suppress(*lost):
                for key, task in missing.items():
                    futures[submit(_play, play, task, code)] = key
            losses += 1
            for future in completed([*futures]):
                key = futures.pop(future)
                with suppress(*lost):
                    result = future.result()
                    del missing[key], future  # a cluster repeats lost results while somebody holds their futures
                    losses = 0
                    yield key, result
        if losses == LOSSES:
            raise HapticdError(
                f"{len(missing)} tasks lost their workers {LOSSES} times (out of memory?): lower --jobs."
            )


@contextmanager
def _processes(jobs: int) -> Iterator[tuple[Any, ...]]:
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
    from multiprocessing import active_children, get_context

    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin) as pool:
        try:
            yield pool.submit, as_completed, (BrokenExecutor,)
        except BaseException:  # minutes of work that are of no use any more
            for process in active_children():
                process.kill()
            raise


def _begin() -> None:
    """Leave Ctrl-C to the campaign, and end with it, even if it is killed: a queue alone would wait for ever."""
    from multiprocessing import parent_process

    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def follow() -> None:
        parent_process().join()  # type: ignore[union-attr]
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Any, ...]]:
    """By Dask's own futures: those of `Client.get_executor` never end when a worker is lost that has a result still to
    be fetched (distributed 2026.8)."""
    try:
        from distributed import CancelledError, Client, KilledWorker, as_completed
    except ImportError:
        raise missing_library("--cluster needs Dask's distributed", "cluster") from None
    import logging

    for name in ("distributed", "distributed.client"):  # what they say of lost connections is in our sentences
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(address, timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
        client.wait_for_workers(1, timeout=CONNECT_S)
    except (OSError, ValueError, TypeError, OverflowError) as error:
        why = str(error).partition("\n")[0].rstrip(".")
        raise UsageError(
            f"--cluster: no scheduler with workers answers at {address} ({why}): start `dask scheduler`, and "
            f"`dask worker {address} --nthreads 1`."
        ) from None
    with client:
        completed = partial(as_completed, loop=client.loop)
        yield partial(client.submit, pure=False), completed, (KilledWorker, CancelledError)


_ONE_TASK = threading.Lock()  # of a process: workers with several threads play no faster, and give the same


def _play(play: Play, task: object, code: str) -> bytes:
    """Play one task in a worker. Raises HapticdError where its code is another than the campaign's."""
    if code != code_of(play):
        raise HapticdError(
            f"The worker {node()} (process {os.getpid()}) has other sources of hapticd, Python or NumPy than this "
            "campaign: install the same there, and start it again."
        )
    with _ONE_TASK:
        return encode(play(task))


# --- results ---


@contextmanager
def _results(path: Path | None) -> Iterator[Connection]:
    """The database of encoded results by key, in memory without a path. Raises UsageError."""
    import sqlite3

    try:
        if path is not None and is_special(path):
            raise sqlite3.Error("not a regular file")
        with closing(sqlite3.connect(path or ":memory:", isolation_level=None)) as database:
            database.execute("CREATE TABLE IF NOT EXISTS results (key BLOB PRIMARY KEY, result BLOB)")
            yield database
    except sqlite3.Error as error:
        raise UsageError(f"{path}: cannot keep results ({error}): name another file.") from None


def encode(result: object) -> bytes:
    """Return a result as bytes; every number keeps its last bit."""
    return msgspec.msgpack.encode(result, enc_hook=_plain)


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray) and value.dtype == np.float64:
        return value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a result has a {type(value).__name__}")


def _decoded(play: Play, data: bytes) -> Any:
    """Return a result, of the type that `play` is annotated with: no file makes this process run anything."""

    def array(_: type, value: Any) -> Any:
        shape, numbers = msgspec.convert(value, tuple[tuple[int, ...], bytes])
        return np.frombuffer(numbers, np.float64).reshape(shape)

    try:
        return msgspec.msgpack.decode(data, type=get_type_hints(play)["return"], dec_hook=array)
    except (msgspec.MsgspecError, TypeError, ValueError, RecursionError) as error:
        raise HapticdError(f"A kept result is not of its task ({error}): delete the file of results.") from None


def key_of(play: Play, task: object) -> bytes:
    """Return the key of a task's result: other code and another task have another one."""
    from hashlib import blake2b

    return blake2b(encode((code_of(play), play.__qualname__, task)), digest_size=16).digest()


@cache
def code_of(play: Play) -> str:
    """Return the versions of hapticd, Python and NumPy, and a digest of hapticd's sources and those of `play`."""
    from hashlib import blake2b

    digest = blake2b(digest_size=16)
    for package in sorted({"hapticd", play.__module__.partition(".")[0]}):
        file = Path(str(import_module(package).__file__))
        for path in sorted(file.parent.rglob("*")) if file.name == "__init__.py" else [file]:
            if path.suffix in (".py", ".c"):
                digest.update(path.read_bytes())
    return " ".join((__version__, python_version(), np.__version__, digest.hexdigest()))

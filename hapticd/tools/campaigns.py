"""Campaigns: many tasks that do not depend on each other, played by processes of this machine or by a Dask cluster.

The results are in the order of the tasks and the same to the last bit, whoever plays them. With --keep each is added to
an SQLite file when it comes, and later calls play what is missing there: for the same task, sources, Python and NumPy.
"""

from __future__ import annotations

import argparse
import ctypes
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
from typing import Any, TypeVar, get_type_hints

import msgspec
import numpy as np

from ..errors import HapticdError, UsageError, missing_library
from ..regular_file import is_special
from .arguments import whole
from .progress import progress_bar

OPTIONS = ("jobs", "cluster", "keep")
LOSSES = 3  # of workers, without a result between them, that end a campaign
CONNECT_S = 10

Task = TypeVar("Task")
Result = TypeVar("Result")
Play = Callable[[Any], Any]  # a function of a module, with annotations: from a task to its result
_ONE_TASK = threading.Lock()  # of a process, whose worker may have several threads


def add_arguments(parser: argparse._ActionsContainer, part: str = "") -> None:
    """Add --jobs, --cluster and --keep, which are None without their option; `part` says what they belong to."""
    at_once = f"{part}play N tasks at the same time (default: one per processor)"
    parser.add_argument("--jobs", type=whole(1, 1024), metavar="N", help=at_once)
    trusted = f"{part}play them on a Dask cluster, which can run any code here: trust it"
    parser.add_argument("--cluster", metavar="ADDRESS", help=trusted)
    kept = f"{part}keep the results there for later calls, which play only what is missing"
    parser.add_argument("--keep", type=Path, metavar="FILE", help=kept)


def of(options: argparse.Namespace) -> Callable[..., list[Any]]:
    """Return the campaign that the command line asks for. Raises UsageError."""
    if options.jobs is not None and options.cluster is not None:
        raise UsageError("--jobs: a cluster plays as many tasks as it has workers: omit it or --cluster.")
    return partial(run, jobs=options.jobs or len(os.sched_getaffinity(0)), cluster=options.cluster, keep=options.keep)


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
    import sqlite3

    keys, found = [key_of(play, task) for task in tasks], dict[bytes, bytes]()
    try:
        if keep is not None and is_special(keep):
            raise sqlite3.Error("not a regular file")
        with closing(sqlite3.connect(keep or ":memory:", isolation_level=None)) as database:
            database.execute("CREATE TABLE IF NOT EXISTS results (key BLOB PRIMARY KEY, result BLOB)")
            for key in keys:
                found.update(database.execute("SELECT key, result FROM results WHERE key = ?", (key,)))
            missing = {key: task for key, task in zip(keys, tasks, strict=True) if key not in found}
            if found:
                print(f"{what}: {len(found)} of {len({*keys})} were played before.", file=sys.stderr)
            with progress_bar(what) as progress, closing(_played(play, dict(missing), jobs, cluster)) as played:
                for done, (key, result) in enumerate(played, 1):
                    found[key] = result
                    database.execute("INSERT OR REPLACE INTO results VALUES (?, ?)", (key, result))
                    progress(done / len(missing))
    except sqlite3.Error as error:
        raise UsageError(f"{keep}: cannot keep results ({error}): name another file.") from None
    return [_decoded(play, found[key]) for key in keys]


def _played(play: Play, missing: dict[bytes, Any], jobs: int, cluster: str | None) -> Generator[tuple[bytes, bytes]]:
    """Yield keys and encoded results as they come; workers that are lost are replaced."""
    jobs, losses = min(jobs, len(missing)), 0
    if cluster is None and jobs <= 1:
        yield from ((key, encode(play(task))) for key, task in missing.items())
        return
    while missing and losses < LOSSES:
        with _processes(jobs) if cluster is None else _cluster(cluster) as (submit, completed, lost):
            futures, losses = {}, losses + 1
            with suppress(*lost):
                for key, task in missing.items():
                    futures[submit(_play, play, task, code_of(play))] = key
            for future in completed([*futures]):
                key = futures.pop(future)
                with suppress(*lost):
                    result, losses = future.result(), 0
                    del missing[key], future  # a cluster repeats lost results while somebody holds their futures
                    yield key, result
    if missing:
        raise HapticdError(f"{len(missing)} tasks lost their workers {LOSSES} times (out of memory?): lower --jobs.")


@contextmanager
def _processes(jobs: int) -> Iterator[tuple[Any, ...]]:
    from concurrent.futures import BrokenExecutor, ProcessPoolExecutor, as_completed
    from multiprocessing import active_children, get_context

    with ProcessPoolExecutor(
        jobs, mp_context=get_context("spawn"), initializer=_begin, initargs=(os.getpid(),)
    ) as pool:
        try:
            yield pool.submit, as_completed, (BrokenExecutor,)
        except BaseException:  # minutes of work that are of no use any more
            for process in active_children():
                process.kill()
            raise


def _begin(campaign: int) -> None:
    """Leave Ctrl-C to the campaign, a process, and be killed with it: a queue alone would wait for ever."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
    if os.getppid() != campaign:  # it died while this process started
        os._exit(1)


@contextmanager
def _cluster(address: str) -> Iterator[tuple[Any, ...]]:
    """By Dask's own futures: those of `Client.get_executor` never end when a worker is lost that has a result still to
    be fetched (distributed 2026.8)."""
    import asyncio

    try:
        from distributed import CancelledError, Client, KilledWorker, Security, as_completed
        from distributed.comm.core import connect
    except ImportError:
        raise missing_library("--cluster needs Dask's distributed", "cluster") from None

    async def greet() -> None:  # a Client waits for ever for the greeting of a server that is no scheduler
        arguments = Security().get_connection_args("client")  # type: ignore[no-untyped-call]
        greeting = connect(address, timeout=CONNECT_S, **arguments)  # type: ignore[no-untyped-call]
        (await asyncio.wait_for(greeting, CONNECT_S)).abort()

    try:
        asyncio.run(greet())
        client = Client(address, timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
        client.wait_for_workers(1, timeout=CONNECT_S)
    except (OSError, ValueError, TypeError, OverflowError, MemoryError) as error:
        why = str(error).partition("\n")[0].rstrip(".") or "it is another server"
        start = f"start `dask scheduler`, and `dask worker {address} --nthreads 1`"
        raise UsageError(f"--cluster: no scheduler with workers answers at {address} ({why}): {start}.") from None
    with client:
        completed = partial(as_completed, loop=client.loop)
        yield partial(client.submit, pure=False), completed, (KilledWorker, CancelledError)


def _play(play: Play, task: object, code: str) -> bytes:
    """Play one task in a worker. Raises HapticdError where its code is another than the campaign's."""
    if code != code_of(play):
        raise HapticdError(
            f"The worker {node()} has other sources of hapticd, Python or NumPy: install the same there."
        )
    with _ONE_TASK:
        return encode(play(task))


def encode(result: object) -> bytes:
    """Return a result as bytes; every number keeps its last bit. Arrays are of doubles."""

    def plain(value: Any) -> object:
        return (value.shape, np.asarray(value, np.float64).tobytes()) if value.shape else value.item()

    return msgspec.msgpack.encode(result, enc_hook=plain)


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
    """Return the versions of Python and NumPy, and a digest of hapticd's sources and those of `play`."""
    from hashlib import blake2b

    digest = blake2b(digest_size=16)
    for package in sorted({"hapticd", play.__module__.partition(".")[0]}):
        file = Path(str(import_module(package).__file__))
        for path in sorted(file.parent.rglob("*")) if file.name == "__init__.py" else [file]:
            if path.suffix in (".py", ".c"):
                digest.update(path.read_bytes())
    return f"{python_version()} {np.__version__} {digest.hexdigest()}"

"""Workers of a campaign: processes of this machine, or those of a Dask cluster; both as `concurrent.futures`.

A task whose worker is lost is repeated, LOSSES - 1 times at most. Locally all tasks that run go with the worker, for a
pool without one of its processes ends; so no more are handed over than run, and the lost ones run alone. Dask repeats
what the worker had.
"""

from __future__ import annotations

import os
import platform
import re
import signal
from collections import Counter, deque
from collections.abc import Generator, Iterator, Mapping
from contextlib import contextmanager
from threading import Thread
from typing import TYPE_CHECKING, Any

from ...errors import HapticdError, UsageError, missing_library
from .results import Play, code_of, encode

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

LOSSES = 3  # of one task's workers, that end the campaign
CONNECT_S = 10
COMPARED = ("python", "numpy", "hapticd", "distributed")  # packages, which a scheduler needs too: it loads the tasks

Missing = Mapping[bytes, Any]  # tasks by their keys
Played = Generator[tuple[bytes, bytes], None, None]  # keys and encoded results, as they come


def in_this_process(play: Play, missing: Missing) -> Played:
    """Play the tasks one after another."""
    for key, task in missing.items():
        yield key, encode(play(task))


def by_processes(play: Play, missing: Missing, jobs: int) -> Played:
    """Play the tasks in `jobs` processes. Raises HapticdError when a task loses them again and again."""
    from concurrent.futures import BrokenExecutor

    waiting, losses = deque(missing), Counter[bytes]()
    while waiting:
        running: dict[Future[bytes], bytes] = {}
        with _processes(jobs) as pool:
            try:
                while waiting or running:
                    while waiting and len(running) < _most(jobs, losses, waiting[0], running):
                        running[pool.submit(_play, play, missing[waiting[0]])] = waiting[0]
                        waiting.popleft()
                    yield from _finished(running)
            except BrokenExecutor:
                yield from _rescued(running)
        for key in running.values():
            losses[key] += 1
            if losses[key] == LOSSES:
                raise HapticdError(
                    f"Task {list(missing).index(key) + 1} of {len(missing)} lost its process {LOSSES} times (killed, "
                    "or out of memory?): play fewer at the same time with --jobs."
                )
        waiting.extendleft(running.values())


def _most(jobs: int, losses: Mapping[bytes, int], following: bytes, running: Mapping[Future[bytes], bytes]) -> int:
    """Return how many may run: a task that was lost runs alone, so that it shows which one took its process along."""
    return 1 if any(losses[key] for key in (following, *running.values())) else jobs


def _finished(running: dict[Future[bytes], bytes]) -> Played:
    """Wait for some of what runs; what has a result is yielded, and runs no more."""
    from concurrent.futures import FIRST_COMPLETED, wait

    for future in wait(running, return_when=FIRST_COMPLETED).done:
        result = future.result()
        yield running.pop(future), result


def _rescued(running: dict[Future[bytes], bytes]) -> Played:
    """Of a pool that ended: yield what was finished before."""
    from concurrent.futures import wait

    for future in wait(running).done:
        if future.exception() is None:
            yield running.pop(future), future.result()


@contextmanager
def _processes(jobs: int) -> Iterator[Executor]:
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import active_children, get_context

    others = {*active_children()}
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin) as pool:
        try:
            yield pool
        except BaseException:  # minutes of work that are of no use any more
            for process in {*active_children()} - others:
                process.kill()
            raise


def _begin() -> None:
    """Leave Ctrl-C to the campaign, and end with it, even if it is killed: a queue alone would wait for ever."""
    from multiprocessing import parent_process

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    Thread(target=follow, daemon=True).start()


def _play(play: Play, task: object, code: str | None = None) -> bytes:
    """Play one task in a worker, whose code is compared if `code` is given. Raises HapticdError."""
    if code is not None and code != code_of(play):
        raise HapticdError(
            f"The worker {platform.node()} (process {os.getpid()}) has other sources of hapticd than this campaign, "
            "of the same version: install the same there, and start it again."
        )
    return encode(play(task))


def by_cluster(play: Play, missing: Missing, address: str) -> Played:
    """Play the tasks on the cluster of the Dask scheduler at `address`. Raises HapticdError.

    By Dask's own futures: those of `Client.get_executor` never end when a worker is lost that has a result still to be
    fetched (distributed 2026.8).
    """
    code = code_of(play)
    with _client(address) as client:
        from distributed import CancelledError, KilledWorker, as_completed

        futures = [client.submit(_play, play, task, code, pure=False) for task in missing.values()]
        keys = {future.key: key for future, key in zip(futures, missing, strict=True)}
        try:
            for future in as_completed(futures, loop=client.loop):  # type: ignore[no-untyped-call]
                result = future.result()
                future.release()  # or it is played again when the worker is lost that has it
                yield keys[future.key], result
        except KilledWorker:
            raise HapticdError(
                f"A task on the cluster {address} lost its worker again and again (killed, or out of memory?): see the "
                "workers' logs."
            ) from None
        except (CancelledError, OSError):
            raise HapticdError(
                f"The scheduler {address} was lost: start it, and the same command again to go on."
            ) from None


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """Connect to a scheduler and compare its versions and the workers'. Raises HapticdError."""
    try:
        from distributed import Client
    except ImportError:
        raise missing_library("--cluster needs Dask's distributed", "cluster") from None
    import logging
    import socket

    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what it says of lost connections is in our sentences
    try:
        host, _, port = address.rpartition("://")[2].rpartition(":")
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_S).close()  # a client that fails leaves threads
        client = Client(address, timeout=CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TypeError, OverflowError) as error:
        why = str(error).partition("\n")[0].rstrip(".")
        raise UsageError(
            f"--cluster: no scheduler answers at {address} ({why}): start one with `dask scheduler`, and workers with "
            f"`dask worker {address} --nthreads 1`."
        ) from None
    with client:
        _check(client, address)
        yield client


def _check(client: Any, address: str) -> None:
    threads = client.nthreads()
    if not threads:
        raise HapticdError(f"The cluster {address} has no worker: start `dask worker {address} --nthreads 1`.")
    found = client.get_versions(packages=["hapticd"])
    own = _versions(found["client"])
    others = {"scheduler": found["scheduler"]} | {f"worker {name}": one for name, one in found["workers"].items()}
    for who, one in others.items():
        for package, version in _versions(one).items():
            if version != own[package]:
                has = f"{package} {version}" if version else f"no {package}"
                raise HapticdError(f"The {who} has {has}, this campaign {own[package]}: install the same on both.")
    for worker, count in threads.items():
        if count > 1:
            raise HapticdError(f"The worker {worker} plays {count} tasks in one process: start it with --nthreads 1.")


def _versions(of: Any) -> dict[str, str | None]:
    """Return the compared packages' versions, of Python the first three numbers."""
    packages = of["packages"]
    numbers = re.match(r"\d+\.\d+\.\d+", packages["python"])
    return {name: packages[name] for name in COMPARED} | {"python": numbers[0] if numbers else packages["python"]}

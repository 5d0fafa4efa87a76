"""Limits of this process that libzmq does not survive: without a descriptor or a thread it ends the process (abort)."""

from __future__ import annotations

import resource
import threading

from ...errors import HapticdError


def require_descriptors(needed: int) -> None:
    """Raise the soft limit of open files if it is lower. Raises HapticdError if the hard limit is."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft >= needed or soft == resource.RLIM_INFINITY:
        return
    if hard < needed and hard != resource.RLIM_INFINITY:
        raise HapticdError(
            f"This process may open {hard} files (RLIMIT_NOFILE), and all clients together need up to {needed}: raise "
            f"the hard limit with `ulimit -n {needed}` as root, or LimitNOFILE={needed} in the unit."
        )
    resource.setrlimit(resource.RLIMIT_NOFILE, (needed, hard))


def require_threads(needed: int) -> None:
    """Start as many threads and end them again. Raises HapticdError if that fails."""
    begun, ending = [], threading.Event()
    try:
        for _ in range(needed):
            thread = threading.Thread(target=ending.wait)
            thread.start()
            begun.append(thread)
    except RuntimeError:
        raise HapticdError(
            f"This process can start {len(begun)} threads, and ZeroMQ needs {needed}: end other processes of this "
            "user, or raise RLIMIT_NPROC (`ulimit -u`), or TasksMax= in the unit."
        ) from None
    finally:
        ending.set()
        for thread in begun:
            thread.join()

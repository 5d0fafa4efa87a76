"""The limit of open files, which libzmq does not survive: without a descriptor it ends the process (abort)."""

from __future__ import annotations

import resource

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

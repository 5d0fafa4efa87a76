"""Limits of open files and threads, checked before ZeroMQ meets them."""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest

from hapticd.errors import HapticdError
from hapticd.io.host.limits import require_descriptors
from hapticd.tools.service import MAX_DESCRIPTORS

WITHIN_S = 120.0
RUN = """
import resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
from hapticd.__main__ import main
sys.exit(main(["run", "--sim", "--check"]))
"""


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The process's limits, the newest last."""
    found: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: found[-1])
    monkeypatch.setattr(resource, "setrlimit", lambda _, pair: found.append(pair))
    return found


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ((64, 4096), (900, 4096)),
        ((64, resource.RLIM_INFINITY), (900, resource.RLIM_INFINITY)),
        ((64, 900), (900, 900)),
        ((1024, 4096), (1024, 4096)),
        ((resource.RLIM_INFINITY, resource.RLIM_INFINITY), (resource.RLIM_INFINITY, resource.RLIM_INFINITY)),
    ],
)
def test_a_soft_limit_is_raised_as_far_as_needed(
    limits: list[tuple[int, int]], before: tuple[int, int], after: tuple[int, int]
) -> None:
    limits.append(before)
    require_descriptors(900)
    assert limits[-1] == after


def test_a_hard_limit_that_does_not_suffice_is_named_with_what_to_do(limits: list[tuple[int, int]]) -> None:
    limits.append((64, 899))
    with pytest.raises(HapticdError, match=r"899.* 900: .*ulimit -n 900.*LimitNOFILE=900"):
        require_descriptors(900)
    assert limits == [(64, 899)]


def test_the_service_is_refused_in_a_sentence_where_it_may_not_open_enough_files() -> None:
    ended = subprocess.run([sys.executable, "-c", RUN], capture_output=True, text=True, timeout=WITHIN_S, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1)
    assert f"may open 64 files (RLIMIT_NOFILE), and all clients together need up to {MAX_DESCRIPTORS}" in ended.stderr

"""Runner of campaigns: plays tasks with the workers that the command line asks for, and goes on where it was stopped.

    with runner.of(options) as campaign:
        scores = campaign("worlds", play, jobs)    # play: a function of a module, from a job to its scores

The results are in the order of the tasks and the same to the last bit, whoever plays them and in whatever order. Until
the campaign's end they lie in the user's cache, so the same command goes on where it was stopped; --keep keeps them.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, TypeVar

from ...errors import UsageError
from ..arguments import whole
from ..progress import Progress

if TYPE_CHECKING:
    from .engines import Missing, Played
    from .results import Play, Results

OPTIONS = ("jobs", "cluster", "keep")
STALE_S = 30 * 24 * 3600.0  # a campaign that was stopped so long ago is given up

Task = TypeVar("Task")
Result = TypeVar("Result")


def add_arguments(parser: argparse._ActionsContainer, part: str = "") -> None:
    """Add --jobs, --cluster and --keep, which are None without their option; `part` says what they belong to."""
    parser.add_argument(
        "--jobs",
        type=whole(1, 1024),
        metavar="N",
        help=f"{part}play N tasks at the same time (default: one per processor)",
    )
    parser.add_argument(
        "--cluster", metavar="ADDRESS", help=f"{part}play them on a Dask cluster, such as tcp://10.0.0.1:8786"
    )
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FILE",
        help=f"{part}keep the results there for later calls, which play only what is missing (default: until the end)",
    )


def of(options: argparse.Namespace) -> Campaign:
    """Return the campaign that the command line asks for. Raises UsageError."""
    if options.jobs is not None and options.cluster is not None:
        raise UsageError("--jobs: a cluster plays as many tasks as it has workers: omit it or --cluster.")
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser()) / "hapticd" / "campaigns"
    jobs = len(os.sched_getaffinity(0)) if options.jobs is None else options.jobs
    return Campaign(jobs, cluster=options.cluster, keep=options.keep, cache=cache)


class Campaign:
    """Plays tasks, call by call. Without arguments it plays them in this process and keeps nothing."""

    def __init__(
        self, jobs: int = 1, *, cluster: str | None = None, keep: Path | None = None, cache: Path | None = None
    ) -> None:
        """Keep the results in the file `keep`, else in files of the folder `cache` until the end, else not."""
        self._jobs, self._cluster, self._keep, self._cache = jobs, cluster, keep, cache
        self._cached: list[Path] = []

    def __enter__(self) -> Campaign:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: BaseException | TracebackType | None) -> None:
        if kind is None:
            for path in self._cached:
                path.unlink(missing_ok=True)

    def __call__(self, what: str, play: Callable[[Task], Result], tasks: Sequence[Task]) -> list[Result]:
        """Return each task's result; `what` stands before the bar. Raises HapticdError, and what `play` raises."""
        from .results import decoder, key_of

        keys = [key_of(play, task) for task in tasks]
        with closing(self._results(keys)) as results:
            missing = {key: task for key, task in zip(keys, tasks, strict=True) if key not in results}
            if len(missing) < len(set(keys)):
                print(
                    f"{what}: {len(set(keys)) - len(missing)} of {len(set(keys))} were played before.", file=sys.stderr
                )
            done = 0
            try:
                with Progress(what) as progress, closing(self._played(play, missing)) as played:
                    for done, (key, result) in enumerate(played, 1):
                        results.add(key, result)
                        progress(done / len(missing))
            except BaseException:
                if done and results.are_kept:
                    print("What was played is kept: the same command goes on from there.", file=sys.stderr)
                raise
            return [*map(decoder(play), map(results.__getitem__, keys))]

    def _played(self, play: Play, missing: Missing) -> Played:
        from . import engines

        if missing and self._cluster is not None:
            return engines.by_cluster(play, missing, self._cluster)
        jobs = min(self._jobs, len(missing))
        return engines.by_processes(play, missing, jobs) if jobs > 1 else engines.in_this_process(play, missing)

    def _results(self, keys: Sequence[bytes]) -> Results:
        """Open the place for the results of these tasks. Raises HapticdError."""
        from hashlib import blake2b

        from .results import Results

        if self._keep is not None or self._cache is None:
            return Results(self._keep)
        path = self._cache / f"{blake2b(b''.join(keys), digest_size=16).hexdigest()}.results"
        try:
            self._cache.mkdir(parents=True, exist_ok=True)
            for other in self._cache.glob("*.results"):
                if time.time() - other.stat().st_mtime > STALE_S:
                    other.unlink(missing_ok=True)
            results = Results(path)
        except (OSError, UsageError):  # no home, or the same campaign runs: then it cannot go on after it was stopped
            return Results()
        self._cached.append(path)
        return results

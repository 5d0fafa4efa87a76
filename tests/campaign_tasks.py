"""Cheap tasks of a campaign, in a module that its workers import."""

from __future__ import annotations

import os
import signal
import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hapticd.values import FloatArray


class Task(NamedTuple):
    """A seed; `folder` gets a file for each time that it is played. It kills its process `deaths` times, that of the
    campaign once when the file `ends_after` holds three results, and raises if it `fails`."""

    seed: int
    folder: str
    deaths: int = 0
    ends_after: str = ""
    fails: bool = False


class Outcome(NamedTuple):
    total: float
    drawn: FloatArray
    worst: float | None
    process: int
    blas_threads: str


def play(task: Task) -> Outcome:
    played = times_played(Path(task.folder), task.seed)
    Path(task.folder, f"{task.seed}-{played}").touch()
    if played < task.deaths:
        os.kill(os.getpid(), signal.SIGKILL)
    if task.ends_after and played == 0:
        with closing(sqlite3.connect(task.ends_after)) as kept:
            while kept.execute("SELECT COUNT(*) FROM results").fetchone()[0] < 3:
                time.sleep(0.01)
        os.kill(os.getppid(), signal.SIGKILL)
        signal.pause()
    if task.fails:
        raise ValueError(f"seed {task.seed} has no plate")
    drawn = np.random.default_rng(task.seed).standard_normal((3, 4))
    worst = None if task.seed % 2 else float("inf")
    return Outcome(np.exp(drawn).sum(), drawn.T, worst, os.getpid(), os.environ["OPENBLAS_NUM_THREADS"])


def times_played(folder: Path, seed: int) -> int:
    return len([*folder.glob(f"{seed}-*")])

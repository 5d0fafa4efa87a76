"""Which mutants live: `python tests/mutation/trial.py host` for core/trajectory/gate.py, `board` for the firmware's
limiter.

Every mutant meets the limiter's own tests in a process of its own, so that one that crashes, or never ends, is dead
and does no harm. The answer is JSON: how many there were, and those that no test killed, as `text of the line: change`.
"""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import inspect
import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import types
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from hypothesis import is_hypothesis_test

sys.path.insert(0, str(Path(__file__).parents[1]))
os.environ["HAPTICD_PURE"] = "1"  # mutants are of the Python, and what calls them must not be machine code

import hapticd.core.trajectory
from hapticd.core.trajectory import gate as limits
from hapticd.sim.board import firmware
from mutation import c_mutants, python_mutants
from mutation.python_mutants import Mutant

ROOT = Path(__file__).parents[2]
HOST_TESTS = ("tests/core/trajectory/test_gate.py",)
BOARD_TESTS = (
    "tests/firmware/test_limiter_bits.py",
    "tests/firmware/test_limits_agree.py",
    "tests/firmware/test_gate.py",
)
LIMITER = ROOT / "firmware/core/limiter.c"
BOARD_SOURCES = {
    LIMITER: ("all_finite", "scale_all", "silence", "hd_limit_amplitudes", "hd_shorten", "hd_limit_voltages"),
    LIMITER.with_suffix(".h"): ("hd_limit_magnitude",),
    LIMITER.with_name("phasor.h"): ("hd_scale", "hd_dot", "hd_magnitude", "hd_within", "hd_finite", "hd_smaller"),
}
COMPILE = ("gcc", "-std=c11", "-O1", "-ffp-contract=off", "-w", "-fPIC", "-shared")
PATIENCE = 2.0  # times the processor seconds that the sound code takes


def host_trial() -> tuple[int, list[str]]:
    path = Path(str(limits.__file__))
    return trial(list(python_mutants.mutants(path.read_text())), path, install_host)


def install_host(path: Path, source: str) -> None:
    mutant = types.ModuleType("hapticd.core.trajectory.gate")
    mutant.__package__ = "hapticd.core.trajectory"
    mutant.__file__ = str(path)
    exec(compile(source, path, "exec"), mutant.__dict__)
    sys.modules[mutant.__name__] = mutant
    hapticd.core.trajectory.gate = mutant
    run_tests(HOST_TESTS)


def board_trial() -> tuple[int, list[str]]:
    lived: list[str] = []
    count = 0
    for path, functions in BOARD_SOURCES.items():
        of_file, left = trial(list(c_mutants.mutants(path.read_text(), functions)), path, install_board)
        count += of_file
        lived += [f"{path.name} {one}" for one in left]
    return count, lived


def install_board(path: Path, source: str) -> None:
    """The limiter alone, compiled with one file changed; the tests reach it where they reach the firmware."""
    with tempfile.TemporaryDirectory() as folder:
        for name in ("limiter.c", "limiter.h", "phasor.h", "protocol.h"):
            Path(folder, name).write_text((LIMITER.with_name(name)).read_text())
        Path(folder, path.name).write_text(source)

        @cache
        def load(modes: int) -> ctypes.CDLL:
            library = f"{folder}/limiter{modes}.so"
            subprocess.run([*COMPILE, f"-DHD_MODES={modes}", f"{folder}/limiter.c", "-lm", "-o", library], check=True)
            return ctypes.CDLL(library)

        firmware.load = load
        run_tests(BOARD_TESTS)


def trial(found: Sequence[Mutant], path: Path, install: Callable[[Path, str], None]) -> tuple[int, list[str]]:
    """How many mutants of the file at `path` there are, and the living ones as `text of the line: change`."""
    begun_s = processor_s()
    if is_killed(lambda: install(path, path.read_text()), 60.0):
        raise SystemExit(f"the tests fail for {path} as it is")
    patience_s = 0.5 + PATIENCE * (processor_s() - begun_s)
    lived = [
        f"{text}: {change}"
        for text, change, source in found
        if not is_killed(lambda source=source: install(path, source), patience_s)
    ]
    return len(found), lived


def processor_s() -> float:
    """Used so far by this process's children."""
    times = os.times()
    return times.children_user + times.children_system


def is_killed(body: Callable[[], None], patience_s: float) -> bool:
    """Whether `body` fails, crashes or does not end, in a process of its own."""
    child = os.fork()
    if child == 0:
        signal.setitimer(signal.ITIMER_PROF, patience_s)  # its signal ends the process
        try:
            with open(os.devnull, "w") as nowhere:
                os.dup2(nowhere.fileno(), 1)
                os.dup2(nowhere.fileno(), 2)
            body()
        except BaseException:
            os._exit(1)
        os._exit(0)
    return os.waitpid(child, 0)[1] != 0


def run_tests(files: Sequence[str]) -> None:
    """The tests of some files that draw nothing at random: what they check must be enough to tell every mutant."""
    for test in (test for file in files for test in tests_of(ROOT / file)):
        for arguments in cases(test):
            test(**arguments)


def tests_of(path: Path) -> Iterator[Callable[..., None]]:
    spec = importlib.util.spec_from_file_location(f"trial_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    for name, value in vars(module).items():
        if name.startswith("test_") and inspect.isfunction(value) and not is_hypothesis_test(value):
            yield value


def cases(test: Callable[..., None]) -> Iterator[dict[str, Any]]:
    """The arguments that pytest.mark.parametrize gives a test."""
    tables: list[list[dict[str, Any]]] = []
    for mark in getattr(test, "pytestmark", []):
        names = mark.args[0].split(",") if isinstance(mark.args[0], str) else list(mark.args[0])
        rows = [row if len(names) > 1 else (row,) for row in mark.args[1]]
        tables.append([dict(zip(names, row, strict=True)) for row in rows])
    for combination in itertools.product(*tables):
        yield {name: value for part in combination for name, value in part.items()}


def main() -> None:
    tests_before = [test for file in HOST_TESTS + BOARD_TESTS for test in tests_of(ROOT / file)]  # imports warmed up
    assert tests_before
    gc.freeze()
    count, lived = {"host": host_trial, "board": board_trial}[sys.argv[1]]()
    print(json.dumps({"mutants": count, "lived": lived}, indent=1))


if __name__ == "__main__":
    main()

"""Coverage-guided fuzzing with atheris: `python tests/fuzz/explore.py TARGET --seconds 60`, or all targets in turn.

New inputs start from the kept corpus and the seeds, and are thrown away at the end: only what was found wrong stays,
in the present directory as `crash-*`. `--keep` also rewrites the corpus: the seeds, and of what was found the
smallest inputs that go a new way. Exit code 77: atheris is not installed (it has wheels for Linux and
CPython 3.11 to 3.13).
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

TIME_OUT_S = 10  # for one input; the counted bounds are far below
MEMORY_MB = 1024
MAX_KEPT_BYTES = 512  # of an input in the corpus that is not a seed
MISSING = 77
INSTRUMENTED = [
    "hapticd.files.calibration",
    "hapticd.config.loader",
    "hapticd.config.keys",
    "hapticd.core.plate.mode_shapes",
    "hapticd.formats.mode_map",
    "hapticd.io.devices.replay",
    "hapticd.files.recording",
    "hapticd.formats.toml_file",
    "hapticd.tools.gateway",
    "hapticd.wire",
    "hapticd_client.messages",
    "hapticd_contract",
    "mcap",
    "pythonosc",
    "tomllib",
    "zipfile",
]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", nargs="?", help="all, one after the other, where it is left out")
    parser.add_argument("--seconds", type=int, default=20, help="for each target")
    parser.add_argument("--runs", type=int, default=-1, help="at most so many inputs for each target")
    parser.add_argument("--seed", type=int, default=0, help="the same inputs each time; 0, the default, draws new ones")
    parser.add_argument("--keep", action="store_true", help="rewrite the corpus")
    parser.add_argument("--child", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    given = parser.parse_args()
    try:
        import atheris  # noqa: F401
    except ImportError:
        print("atheris is not installed: no coverage-guided fuzzing", file=sys.stderr)
        return MISSING
    if given.child is not None:
        return fuzz(given.target, given.child)
    from fuzz.targets import TARGETS

    for name in [given.target] if given.target else TARGETS:
        with tempfile.TemporaryDirectory() as folder:
            code = run(
                name, Path(folder), [f"-max_total_time={given.seconds}", f"-runs={given.runs}", f"-seed={given.seed}"]
            )
            if code == 0 and given.keep:
                keep(name, Path(folder))
        if code != 0:
            return code
    return 0


def run(name: str, folder: Path, flags: list[str]) -> int:
    """libFuzzer leaves its process without a word to Python: each run is one of its own."""
    from fuzz.targets import TARGETS

    target = TARGETS[name]
    found, seeds = folder / "found", folder / "seeds"
    for directory in (found, seeds):
        directory.mkdir()
    for label, data in target.seeds().items():
        (seeds / label).write_bytes(data)
    fixed = [f"-max_len={target.max_len}", f"-timeout={TIME_OUT_S}", f"-rss_limit_mb={MEMORY_MB}"]
    corpus = [str(target.corpus)] if target.corpus.exists() else []
    return subprocess.run(
        [sys.executable, __file__, name, "--child", *fixed, *flags, str(found), str(seeds), *corpus],
        env={**os.environ, "TMPDIR": str(folder)},  # libFuzzer ends the process in the middle of an input
        check=False,
    ).returncode


def keep(name: str, folder: Path) -> None:
    """The seeds by their names, and of what was found the short inputs that reach a line no smaller one does."""
    from fuzz.target import lines_reached
    from fuzz.targets import TARGETS

    target = TARGETS[name]
    shutil.rmtree(target.corpus, ignore_errors=True)
    target.corpus.mkdir()
    reached: set[tuple[str, int, int]] = set()
    for label, data in target.seeds().items():
        (target.corpus / label.replace(" ", "-")).write_bytes(data)
        reached |= lines_reached(target.check, data)
    found = sorted((folder / "found").iterdir(), key=lambda path: (path.stat().st_size, path.name))
    for path in found:
        data = path.read_bytes()
        if len(data) <= MAX_KEPT_BYTES and (new := lines_reached(target.check, data) - reached):
            (target.corpus / path.name[:12]).write_bytes(data)
            reached |= new


def fuzz(name: str, flags: list[str]) -> int:
    """In the process of its own: instrumented, warnings are errors. Never returns where libFuzzer begins."""
    import atheris

    # Machine code tells atheris nothing, and what finds the sources must be there before it.
    os.environ["HAPTICD_PURE"] = "1"
    import hapticd  # noqa: F401

    sys.path.insert(0, str(Path(__file__).parents[1]))
    with atheris.instrument_imports(include=INSTRUMENTED):
        from fuzz.targets import TARGETS

    warnings.simplefilter("error")
    atheris.Setup([sys.argv[0], *flags], TARGETS[name].check)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())

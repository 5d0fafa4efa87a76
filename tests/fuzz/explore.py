"""Coverage-guided fuzzing with atheris: `python tests/fuzz/explore.py TARGET --seconds 60`, or all targets in turn.

New inputs start from the kept corpus and the seeds, and are thrown away at the end: only what was found wrong stays,
in the present directory as `crash-*`. Flags of libFuzzer, such as -runs=9, are passed on. Exit code 77: atheris is not
installed (it has wheels for Linux and CPython 3.11 to 3.13).
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

TIME_OUT_S = 10  # for one input; the counted bounds are far below
MEMORY_MB = 1024
MISSING = 77
INSTRUMENTED = [
    "hapticd.config", "hapticd.io.devices.replay", "hapticd.formats.toml_file",
    "hapticd.wire", "hapticd_contract", "pythonosc", "tomllib",
]  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", nargs="?", help="all, one after the other, where it is left out")
    parser.add_argument("--seconds", type=int, default=20, help="for each target")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    given, flags = parser.parse_known_args()
    if importlib.util.find_spec("atheris") is None:
        print("atheris is not installed: no coverage-guided fuzzing", file=sys.stderr)
        return MISSING
    if given.child:
        return fuzz(given.target, flags)
    from fuzz.test_decoders import TARGETS

    codes = (
        run(name, [f"-max_total_time={given.seconds}", *flags]) for name in TARGETS if given.target in (None, name)
    )
    return next((code for code in codes if code != 0), 0)


def run(name: str, flags: list[str]) -> int:
    """libFuzzer leaves its process without a word to Python: each run is one of its own."""
    from fuzz.test_decoders import TARGETS

    target = TARGETS[name]
    with tempfile.TemporaryDirectory() as folder:
        found, seeds = Path(folder, "found"), Path(folder, "seeds")
        for directory in (found, seeds):
            directory.mkdir()
        for label, data in target.seeds().items():
            (seeds / label).write_bytes(data)
        fixed = [f"-max_len={target.max_len}", f"-timeout={TIME_OUT_S}", f"-rss_limit_mb={MEMORY_MB}"]
        return subprocess.run(
            [sys.executable, __file__, name, "--child", *fixed, *flags, str(found), str(seeds), str(target.corpus)],
            env={**os.environ, "TMPDIR": folder},  # libFuzzer ends the process in the middle of an input
            check=False,
        ).returncode


def fuzz(name: str, flags: list[str]) -> int:
    """In the process of its own: instrumented, warnings are errors. Never returns where libFuzzer begins."""
    import atheris

    # Machine code tells atheris nothing, and what finds the sources must be there before it.
    os.environ["HAPTICD_PURE"] = "1"
    import hapticd  # noqa: F401

    with atheris.instrument_imports(include=INSTRUMENTED):
        from fuzz.test_decoders import TARGETS

    warnings.simplefilter("error")
    check = TARGETS[name].check
    atheris.Setup([sys.argv[0], *flags], lambda data: check(data) and None)
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())

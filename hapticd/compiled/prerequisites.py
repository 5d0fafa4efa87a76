"""Requirements of an installation: `make` runs this file first, `build_ext.py` asks before mypyc begins.

It uses the standard library alone and parses on Python 3.7, so that an old one gets a sentence too.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import sysconfig
import tempfile
from importlib.util import find_spec
from pathlib import Path

OLDEST_PYTHON = (3, 11)
REMEDY = "on Debian or Ubuntu run `sudo apt install build-essential python3-dev python3-venv`."


def missing_for_c() -> str:
    """Return what keeps the C compiler of this Python from building a library, empty if nothing does."""
    compiler = os.environ.get("CC") or sysconfig.get_config_var("CC") or "gcc"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "try.c")
        source.write_text(
            "#include <Python.h>\n#include <math.h>\ndouble root(double x) { return sqrt(x); }\n", encoding="utf-8"
        )
        command = [*shlex.split(compiler), "-shared", "-fPIC", "-I", sysconfig.get_path("include")]
        try:
            output = ["-lm", "-o", str(source.with_suffix(".so"))]
            subprocess.run([*command, str(source), *output], capture_output=True, check=True)
        except OSError:
            return f"the C compiler `{compiler}` is not installed"
        except subprocess.CalledProcessError as error:
            complaints = error.stderr.decode(errors="replace").splitlines()
            first = next((line for line in complaints if "error" in line), "no reason given")
            return f"the C compiler `{compiler}` cannot build a module for Python ({first.strip()})"
    return ""


def not_built(problem: str) -> str:
    """Return the sentence for a `problem` of the compiler."""
    return f"hapticd is not built: {problem}: {REMEDY}"


def missing() -> str:
    """Return what a checkout lacks for `make`, with its remedy; empty if nothing."""
    if sys.version_info < OLDEST_PYTHON:
        oldest, found = (".".join(map(str, version[:2])) for version in (OLDEST_PYTHON, sys.version_info))
        return (
            f"hapticd needs Python {oldest} or newer, and {sys.executable} is {found}: "
            f"name another, such as `make demo PYTHON=python{oldest}`."
        )
    if find_spec("ensurepip") is None:
        return f"hapticd is not installed: {sys.executable} cannot make virtual environments: {REMEDY}"
    problem = missing_for_c()
    return problem and not_built(problem)


if __name__ == "__main__":
    sys.exit(missing() or 0)

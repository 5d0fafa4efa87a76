"""Whether the touch path runs as machine code or as Python: the same source either way, and the same results.

`build_ext.py` has mypyc compile modules of `core` and `wire`; each compiled one lies beside its source, and Python
would always take it. It must not where HAPTICD_PURE=1 asks for Python, nor in a checkout whose sources were edited
since the build. It is all or none: compiled modules call each other without asking Python.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from importlib.machinery import EXTENSION_SUFFIXES, ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path

PACKAGE = Path(__file__).parent
FOLDERS = ("core", "wire")
PROJECT = Path(__file__).parents[1] / "pyproject.toml"  # only a checkout has it


class SourceFinder:
    """Finds the modules of `core` and `wire` as Python source, whatever else lies beside them."""

    def find_spec(self, fullname: str, *_more: object) -> ModuleSpec | None:
        """Where a module is, for `sys.meta_path`; None leaves it to others."""
        package, _, name = fullname.rpartition(".")
        folder = package.removeprefix("hapticd.")
        source = PACKAGE / folder / f"{name}.py"
        is_ours = package.startswith("hapticd.") and folder in FOLDERS and source.exists()
        return spec_from_file_location(fullname, source) if is_ours else None


def choose() -> None:
    """Called once, before anything of `core` or `wire` is imported."""
    if why_interpreted() != "":
        sys.meta_path.insert(0, SourceFinder())


def why_interpreted() -> str:
    """Why the touch path runs as Python; empty where it runs as machine code."""
    if os.environ.get("HAPTICD_PURE", "0") != "0":
        return "HAPTICD_PURE asks for it"
    found = [path for folder in FOLDERS for path in (PACKAGE / folder).glob(f"*{EXTENSION_SUFFIXES[0]}")]
    compiled = [path.with_name(path.name.split(".")[0]) for path in found]
    if not compiled:
        return "it was built without mypyc"
    if PROJECT.exists() and _is_stale(compiled):
        return "a source was edited after the build: `make` or `pip install -e .` compiles it again"
    return ""


def _is_stale(compiled: Sequence[Path]) -> bool:
    """Some source is newer than what was made of them."""
    sources = [path for stem in compiled if (path := stem.with_suffix(".py")).exists()]
    t_built_ns = min(stem.with_name(stem.name + EXTENSION_SUFFIXES[0]).stat().st_mtime_ns for stem in compiled)
    return max(path.stat().st_mtime_ns for path in sources) > t_built_ns

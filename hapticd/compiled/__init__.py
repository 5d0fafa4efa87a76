"""Whether the touch path runs as machine code or as Python: the same source either way, and the same results.

`build_ext.py` has mypyc compile modules of `core` and `wire`; each compiled one lies next to its source, and Python
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

from ..errors import rebuild

PACKAGE = Path(__file__).parents[1]
FOLDERS = ("core", "wire")
PROJECT = PACKAGE.parent / "pyproject.toml"  # only a checkout has it


class SourceFinder:
    """Finds the modules of `core` and `wire` as Python source, whatever else their folder holds."""

    def find_spec(self, fullname: str, *_more: object) -> ModuleSpec | None:
        """Return where a module is, for `sys.meta_path`; None leaves it to others."""
        root, *folders = fullname.split(".")
        if root != "hapticd" or len(folders) < 2 or folders[0] not in FOLDERS:
            return None
        source = PACKAGE.joinpath(*folders).with_suffix(".py")
        return spec_from_file_location(fullname, source) if source.exists() else None


def choose() -> None:
    """Choose machine code or Python; called once, before anything of `core` or `wire` is imported."""
    if why_interpreted() != "":
        sys.meta_path.insert(0, SourceFinder())


def why_interpreted() -> str:
    """Return why the touch path runs as Python; empty where it runs as machine code."""
    if os.environ.get("HAPTICD_PURE", "0") != "0":
        return "HAPTICD_PURE asks for it"
    found = [path for folder in FOLDERS for path in (PACKAGE / folder).rglob(f"*{EXTENSION_SUFFIXES[0]}")]
    built = [path for path in found if _source(path).exists()]  # the kernel in C has none
    if not built:
        return "it was built without mypyc"
    if PROJECT.exists() and _is_stale(built):
        return f"a source was edited after the build: `{rebuild()}` compiles it again"
    return ""


def _is_stale(built: Sequence[Path]) -> bool:
    """Whether some source is newer than the module that was compiled from it."""
    t_built_ns = min(path.stat().st_mtime_ns for path in built)
    return max(_source(path).stat().st_mtime_ns for path in built) > t_built_ns


def _source(module: Path) -> Path:
    return module.with_name(module.name.split(".")[0] + ".py")

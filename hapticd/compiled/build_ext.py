"""What pyproject.toml cannot say: the touch path's modules become machine code, from the same typed source.

Used by setuptools alone. `mypyc` compiles the modules listed there under [tool.hapticd.compiled]. HAPTICD_PURE=1 leaves
them as they are; so does a build without mypy. See hapticd/core/README.md.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

from setuptools import Extension
from setuptools.command import build_ext

GROUP = "hapticd.core.compiled"


class BuildExt(build_ext.build_ext):
    """Builds what pyproject.toml lists, and the compiled modules beside it."""

    def finalize_options(self) -> None:
        """Add them before the extensions are counted; several commands come by here."""
        extensions = self.distribution.ext_modules
        if not any(extension.name.startswith(GROUP) for extension in extensions):
            extensions += compiled_modules()
        super().finalize_options()


def compiled_modules() -> list[Extension]:
    """The extensions that stand in for Python modules; none where the build is to stay pure."""
    if os.environ.get("HAPTICD_PURE", "0") != "0":
        return []
    try:
        from mypyc.build import mypycify
    except ImportError:
        return []
    settings = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["tool"]["hapticd"]["compiled"]
    sources = [f"{module.replace('.', '/')}.py" for module in settings["modules"]]
    extensions = mypycify(sources, opt_level="2", debug_level="0", group_name=GROUP)
    for extension in extensions:
        # To the last bit what the interpreter computes; and calls within the group go straight, not by a table that any
        # program could have changed: half as many of them, which a pass on a cold cache notices.
        extension.extra_compile_args = [*extension.extra_compile_args, "-ffp-contract=off", "-fvisibility=hidden"]
    return extensions

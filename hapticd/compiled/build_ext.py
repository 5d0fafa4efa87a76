"""Builds the C of the simulated board and, with mypyc, the touch path; used by setuptools alone.

`pyproject.toml` lists what: the board's sources as an extension module, the touch path under [tool.hapticd.compiled].
First it writes what protocol.h makes of the board's messages. HAPTICD_PURE=1 leaves the touch path as Python; so does a
build without mypy. Without a C compiler a build fails at once. See hapticd/core/README.md.
"""

from __future__ import annotations

import os
import runpy
import tomllib
from glob import glob
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from threading import Lock

from setuptools import Extension
from setuptools.command import build_ext
from setuptools.errors import PlatformError

PREREQUISITES = runpy.run_path(str(Path(__file__).with_name("prerequisites.py")))  # setuptools loads no package for us
MAKE_PROTOCOL = Path(__file__).parents[2] / "firmware" / "make_protocol.py"
GROUP = "hapticd.core.compiled"
# The same bits as the interpreter's; and calls within the group go straight, not by a table that another library could
# change: half as many indirect calls, which a pass on a cold cache notices. Those to Python's own library take no stub.
FLAGS = ["-ffp-contract=off", "-fvisibility=hidden", "-fno-plt"]
NO_WARNINGS = "-Wno-all"  # Python's own flags ask for them, and with them gcc takes six times as long for generated C
MORE_MODES = range(3, 9)  # than the board's two: up to hapticd.config.sections.MOST_MODES
SINE_TABLE = "firmware/core/sine.c"  # takes the compiler 3 s, and is the same for any number of modes
BOARD = Lock()
LISTING = {"egg_info", "dist_info", "sdist"}  # they build nothing, pip runs two of them first, and mypyc takes 10 s

if MAKE_PROTOCOL.exists():  # an sdist has the module itself
    runpy.run_path(str(MAKE_PROTOCOL))["write_module"]()  # before setuptools lists the modules


class BuildExt(build_ext.build_ext):
    """Builds the board for two to eight modes and the compiled modules, on all cores."""

    def finalize_options(self) -> None:
        """Complete the list of extensions before setuptools counts them; several commands call this."""
        extensions = self.distribution.ext_modules
        for board in [listed for listed in extensions if any("*" in source for source in listed.sources)]:
            board.sources = [path for pattern in board.sources for path in sorted(glob(pattern))]
            board.depends = sorted(glob("firmware/core/*.h") + glob("firmware/boards/host/*.h"))
            is_build = not LISTING.issuperset(self.distribution.commands)
            if is_build and (problem := PREREQUISITES["missing_for_c"]()):
                raise PlatformError(PREREQUISITES["not_built"](problem))
            extensions += [
                *(compiled_modules() if is_build else []),
                *(for_modes(board, modes) for modes in MORE_MODES),
            ]
        super().finalize_options()
        self.parallel = os.cpu_count()

    def run(self) -> None:
        """Build; in a checkout, remove what an earlier build made of modules that are Python now: it fits no other."""
        super().run()
        if self.inplace:
            built = {Path(self.get_ext_fullpath(extension.name)).resolve() for extension in self.extensions}
            for path in Path("hapticd").rglob(f"*{EXTENSION_SUFFIXES[0]}"):
                if path.resolve() not in built:
                    path.unlink()

    def build_extension(self, extension: Extension) -> None:
        """Build one of several at a time, but of boards one, for they share object files; CFLAGS have the last word."""
        extension.extra_compile_args = [*extension.extra_compile_args, *os.environ.get("CFLAGS", "").split()]
        if "firmware" not in extension.name:
            super().build_extension(extension)
            return
        with BOARD:
            table = str(Path(self.build_temp, SINE_TABLE).with_suffix(".o"))
            if os.path.exists(table):
                extension.sources.remove(SINE_TABLE)
                extension.extra_objects.append(table)
            super().build_extension(extension)


def for_modes(board: Extension, modes: int) -> Extension:
    """Return the same library for another number of modes."""
    return Extension(
        f"{board.name}_{modes}modes",
        list(board.sources),
        depends=board.depends,
        include_dirs=board.include_dirs,
        define_macros=[("HD_MODES", str(modes))],
        extra_compile_args=board.extra_compile_args,
        libraries=board.libraries,
    )


def touch_path(checkout: Path) -> list[Path]:
    """Return the sources that are compiled, sorted: all that match, but no `__init__` and none `interpreted`."""
    rule = tomllib.loads((checkout / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hapticd"]["compiled"]
    matching = {path for pattern in rule["sources"] for path in checkout.glob(pattern) if path.stem != "__init__"}
    return sorted(matching - {checkout / path for path in rule["interpreted"]})


def is_pure() -> bool:
    """Return whether the touch path is to stay Python."""
    return os.environ.get("HAPTICD_PURE", "0") != "0"


def compiled_modules() -> list[Extension]:
    """Return the extensions that replace Python modules; none where the build is to stay pure."""
    if is_pure():
        return []
    try:
        from mypyc.build import mypycify
    except ImportError:
        return []
    sources = [str(path) for path in touch_path(Path())]
    extensions = mypycify(sources, opt_level="1", debug_level="0", group_name=GROUP)
    for extension in extensions:
        extension.extra_compile_args = [*extension.extra_compile_args, *FLAGS, NO_WARNINGS]
    # One C file for all: gcc optimizes it at the link, in parts on all cores, and still calls across modules directly.
    group = next(extension for extension in extensions if extension.name.startswith(GROUP))
    for arguments in (group.extra_compile_args, group.extra_link_args):
        arguments.append("-flto=auto")
    return extensions

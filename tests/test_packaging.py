"""What is installed: from a checkout, an sdist and a wheel, with and without a C compiler."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from hapticd import __version__
from hapticd.compiled.build_ext import touch_path

ROOT = Path(__file__).parents[1]
PYPROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
TOOL = PYPROJECT["tool"]
NEEDED = ("pyproject.toml", "Makefile", "README.md", "LICENSE", "hapticd", "clients", "firmware", "systemd", ".lock")
LEFT_OUT = shutil.ignore_patterns("*.so", "__pycache__", "build", "*.egg-info", "board_protocol.py")


@pytest.mark.parametrize(
    ("path", "pattern"),
    [
        ("clients/python/pyproject.toml", r'(?m)^version = "(.*)"$'),
        ("clients/study/hapticd_study/__init__.py", r'(?m)^__version__ = "(.*)"$'),
        (".github/CITATION.cff", r"(?m)^version: (.*)$"),
        ("firmware/core/core.h", r'(?m)^#define HD_FIRMWARE_VERSION "(.*)"$'),
    ],
)
def test_the_version_in_hapticd_is_that_of_everything_that_is_released_with_it(path: str, pattern: str) -> None:
    assert re.findall(pattern, (ROOT / path).read_text(encoding="utf-8")) == [__version__]


def test_the_client_needs_nothing_that_hapticd_which_contains_it_does_not() -> None:
    client = tomllib.loads((ROOT / "clients/python/pyproject.toml").read_text(encoding="utf-8"))["project"]
    project = PYPROJECT["project"]
    assert set(client["dependencies"]) <= set(project["dependencies"])
    assert client["optional-dependencies"]["image"] == project["optional-dependencies"]["image"]
    content = set(client["optional-dependencies"]["content"])
    assert content <= {*project["dependencies"], *project["optional-dependencies"]["image"]}


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of what a build reads, as it is before any build."""
    for name in NEEDED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tmp_path / "checkout" / name, ignore=LEFT_OUT)
        else:
            (tmp_path / "checkout").mkdir(exist_ok=True)
            shutil.copy2(ROOT / name, tmp_path / "checkout")
    return tmp_path / "checkout"


@pytest.fixture
def no_compiler(tmp_path: Path) -> dict[str, str]:
    """The environment of a machine that has `make`, a shell and nothing else."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name in ("make", "sh"):
        (folder / name).symlink_to(str(shutil.which(name)))
    return {"PATH": str(folder), "HOME": str(tmp_path), "TMPDIR": str(tmp_path)}


def build(kind: str, checkout: Path, environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
    """Run a hook of the build backend, as pip does: without this environment's hapticd, and not on the path."""
    code = f"import sys; sys.path.append({sysconfig.get_path('purelib')!r}); "
    code += f"from setuptools import build_meta; build_meta.build_{kind}('dist')"
    command = [sys.executable, "-I", "-S", "-c", code]
    return subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=False)


def test_an_sdist_has_all_that_a_build_reads_and_the_client(checkout: Path, tmp_path: Path) -> None:
    done = build("sdist", checkout, os.environ)
    assert done.returncode == 0, done.stderr
    (archive,) = (checkout / "dist").iterdir()
    with tarfile.open(archive) as tar:
        tar.extractall(tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    assert unpacked.name == f"hapticd-{__version__}"
    assert relative(touch_path(unpacked), unpacked) == relative(touch_path(ROOT), ROOT)
    read = ["hapticd/**/*.py", "hapticd/tools/*/page/*"]
    read += ["firmware/core/*.[ch]"]
    read += ["hapticd/py.typed", "clients/python/hapticd_client/**/*.py", "clients/python/hapticd_client/py.typed"]
    read += [*TOOL["setuptools"]["ext-modules"][0]["sources"], "firmware/boards/host/*.h"]
    read += [file for files in TOOL["setuptools"]["data-files"].values() for file in files]
    for pattern in read:
        wanted = relative(ROOT.glob(pattern), ROOT)
        assert wanted
        assert relative(unpacked.glob(pattern), unpacked) == wanted, pattern


def relative(paths: Any, root: Path) -> list[str]:
    return sorted(str(path.relative_to(root)) for path in paths if path.is_file())


def test_without_a_compiler_make_names_the_packages_and_touches_nothing(
    checkout: Path, no_compiler: dict[str, str]
) -> None:
    command = ["make", "demo", f"PYTHON={sys.executable}"]
    done = subprocess.run(command, cwd=checkout, env=no_compiler, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    line, end = done.stderr.splitlines()
    assert re.match(r"hapticd is not built: the C compiler `.+` is not installed: .*sudo apt install build-ess", line)
    assert end.startswith("make: ***")
    assert not (checkout / ".venv").exists()


def test_without_a_compiler_a_build_ends_with_that_sentence(checkout: Path, no_compiler: dict[str, str]) -> None:
    done = build("wheel", checkout, no_compiler)
    assert done.returncode == 1
    assert re.search(r"^error: hapticd is not built: .*sudo apt install build-essential", done.stderr.splitlines()[-1])
    assert "Traceback" not in done.stderr
    assert not [*(checkout / "build").rglob("*.c")]  # mypyc did not begin

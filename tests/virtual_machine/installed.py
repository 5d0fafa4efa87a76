"""hapticd as a package manager would have put it into /opt, and the /etc of a machine that has nothing else.

The interpreter's own environment is copied, not built again: what is compiled is this checkout's. Left out against a
`pip install`: tests, headers, and commands that need more than the service's own dependencies.
"""

from __future__ import annotations

import shutil
import sys
import sysconfig
from importlib.metadata import distribution
from pathlib import Path

import numpy as np

from hapticd.compiled import FOLDERS, why_interpreted
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.tools.install_service import HIDDEN_BY_UNIT

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
DEPENDENCIES = ("numpy", "msgpack", "msgspec", "mypy-extensions", "pyzmq", "pyserial", "hidapi")
PACKAGES = (ROOT / "hapticd", *(ROOT / "clients/python" / name for name in ("hapticd_client", "hapticd_contract")))
UNNEEDED = shutil.ignore_patterns("tests", "*.pyi", "*.pxd", "*.h", "*.a", "viewer", "bench")
UNITS = (
    "sysinit.target", "basic.target", "sockets.target", "multi-user.target", "shutdown.target", "final.target",
    "systemd-journald.service", "systemd-journald.socket", "systemd-journald-dev-log.socket",
    "systemd-udevd.service", "systemd-udevd-control.socket", "systemd-udevd-kernel.socket",
)  # fmt: skip


def interpreter() -> Path | None:
    """A Python of this version that the service can see: this one, or the distribution's."""
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    for prefix in (Path(sys.base_prefix), Path("/usr"), Path("/usr/local")):
        is_hidden = str(prefix).startswith(tuple(f"{place}/" for place in HIDDEN_BY_UNIT))
        if not is_hidden and (prefix / "bin" / version).exists():
            return prefix / "bin" / version
    return None


def lay_out(opt: Path) -> None:
    """Fill the folder that becomes the guest's /opt."""
    _environment(opt / "hapticd")
    shutil.copytree(FOLDER / "guest", opt / "guest", ignore=shutil.ignore_patterns("__pycache__"))
    _sine_plate().save(opt / "guest/modes.npz")
    (opt / "generators").mkdir()
    (opt / "units").mkdir()
    for name in UNITS:
        shutil.copy2(Path("/lib/systemd/system", name), opt / "units")
    _etc(opt / "etc")


def _sine_plate() -> ModeShapes:
    """A map of the reference plate's wavelength, for the guest's board has no shapes of its own."""
    axis_mm = np.linspace(-68.75, 68.75, 56)
    wave = np.tile(np.sin(2 * np.pi * axis_mm / 27.0), (len(axis_mm), 1))
    return ModeShapes.from_grid(axis_mm, axis_mm, np.stack([wave, wave.T]))


def _environment(venv: Path) -> None:
    """What `python3 -m venv` and `pip install .` leave there.

    A core that was edited after its build goes as source, for the guest's copy could not tell.
    """
    python = interpreter()
    assert python is not None
    site = venv / "lib" / python.name / "site-packages"
    (venv / "bin").mkdir(parents=True)
    site.mkdir(parents=True)
    (venv / "bin/python").symlink_to(python)
    (venv / "pyvenv.cfg").write_text(f"home = {python.parent}\ninclude-system-site-packages = false\n")
    script = Path(sys.executable).with_name("hapticd").read_text(encoding="utf-8").partition("\n")[2]
    (venv / "bin/hapticd").write_text(f"#!/opt/hapticd/bin/python\n{script}", encoding="utf-8")
    (venv / "bin/hapticd").chmod(0o755)
    here = Path(sysconfig.get_path("purelib"))
    shared = (file for file in here.glob("*__mypyc.*.so"))
    names = {Path(str(file)).parts[0] for name in DEPENDENCIES for file in distribution(name).files or ()}
    for source in [*PACKAGES, *shared, *(here / name for name in sorted((names | {"evdev"}) - {"..", "__pycache__"}))]:
        if source.is_dir():
            shutil.copytree(source, site / source.name, ignore=UNNEEDED)
        else:
            shutil.copy2(source, site)
    if why_interpreted() != "":
        for compiled in [path for part in FOLDERS for path in (site / "hapticd" / part).rglob("*.so")]:
            if compiled.with_name(compiled.name.split(".")[0] + ".py").exists():  # the kernel in C has none
                compiled.unlink()
    shutil.copytree(ROOT / "systemd", venv / "share/hapticd/systemd")


def _etc(etc: Path) -> None:
    """Users and groups are this machine's, but for ours; units are none but the guest's own."""
    units = etc / "systemd/system"
    units.mkdir(parents=True)
    for name in ("passwd", "group"):
        lines = Path("/etc", name).read_text(encoding="utf-8").splitlines(keepends=True)
        (etc / name).write_text("".join(line for line in lines if not line.startswith("hapticd")), encoding="utf-8")
    (etc / "nsswitch.conf").write_text("passwd: files\ngroup: files\n")
    (etc / "machine-id").write_text(f"{1:032x}\n")
    for unit in sorted((FOLDER / "guest/units").iterdir()):
        shutil.copy2(unit, units)

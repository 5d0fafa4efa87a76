"""The emulated machine, seen from outside: what it needs, and one boot of it.

QEMU emulates the processor too (no KVM), so that it runs wherever it is installed. The guest sees this machine's root
read-only, and runs its systemd with hapticd in /opt; what it finds it writes to a folder.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
import tempfile
from compileall import compile_dir
from dataclasses import dataclass
from pathlib import Path

import installed

QEMU = "qemu-system-x86_64"
FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
KERNEL = ROOT / "build/virtual_machine/kernel"
INITRAMFS = ROOT / "build/virtual_machine/initramfs.img"
SYSTEMD = Path("/lib/systemd")
PROCESSOR = "Nehalem,+rdrand"  # what wheels ask for; without AVX, for emulated it is slower than doing without
# Mitigations change the page tables at each system call, which takes QEMU a quarter of a boot; the cipher tests 5 s.
KERNEL_WORDS = "console=ttyS0 quiet panic=-1 mitigations=off cryptomgr.notests"
# One instruction is one nanosecond, and one that waits takes as long as it takes: the guest's clock stands while others
# have the processor, so that systemd's time limits hold on a machine however busy.
OWN_CLOCK = ("-icount", "shift=0", "-smp", "1")
BOOT_S = 1200.0  # a boot took 36 s to 240 s on two cores that others used as well
_TAIL = 4000


def missing() -> str | None:
    """Why no guest can run here, in one sentence; None where it can."""
    if platform.machine() != "x86_64":
        return f"the guest runs this machine's own Python on an x86_64 kernel, and this is {platform.machine()}"
    if shutil.which(QEMU) is None or not all((SYSTEMD / name).exists() for name in ("systemd", "systemd-udevd")):
        return f"{QEMU}, systemd or udev is not installed (Debian: qemu-system-x86, systemd, udev)"
    recipes_s = [(FOLDER / name).stat().st_mtime for name in ("make_guest.sh", "init.sh")]
    if not KERNEL.is_file() or not INITRAMFS.is_file() or INITRAMFS.stat().st_mtime < max(recipes_s):
        return "no guest of this recipe: run tests/virtual_machine/make_guest.sh (Debian: busybox-static, cpio, kmod)"
    if installed.interpreter() is None:
        return f"{sys.base_prefix} is hidden from a service, and no other Python of this version is installed"
    return None


@dataclass(frozen=True, slots=True)
class Boot:
    """What came of one boot: a file for each step in `results`, and all that the guest's console said."""

    results: Path
    console: str

    def error(self, step: str) -> str:
        """How a step of the guest's program failed, with the console; empty if it did not."""
        file = self.results / step
        error = file.read_text("utf-8") if file.is_file() else "the guest never came to this step"
        return error and f"{error}\nits console:\n{self.console[-_TAIL:]}"


def boot(results: Path) -> Boot:
    """Boot into systemd, which runs `guest/service.py` to its end and powers off. A guest that hangs is killed: what it
    had found by then counts."""
    compile_dir(str(ROOT / "hapticd"), quiet=1)  # the guest cannot keep what it compiles, and is slow at it
    console = results / "console"
    with tempfile.TemporaryDirectory(prefix="hapticd-guest-") as opt, console.open("wb") as file:
        Path(opt).chmod(0o755)
        installed.lay_out(Path(opt))
        command = [*_command(results), *OWN_CLOCK, *_share(opt, "opt", "readonly=on")]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file) as machine:
            try:
                machine.wait(BOOT_S)
            except subprocess.TimeoutExpired:
                file.write(f"\nkilled after {BOOT_S:.0f} s\n".encode())
            finally:
                machine.kill()  # if it is still there: an interrupted test leaves no machine behind
    return Boot(results, console.read_text(encoding="utf-8", errors="replace"))


def _command(results: Path) -> list[str]:
    return [
        QEMU, "-accel", "tcg", "-cpu", PROCESSOR, "-m", "1024", "-nodefaults", "-no-reboot",
        "-display", "none", "-monitor", "none", "-serial", "stdio",
        "-kernel", str(KERNEL), "-initrd", str(INITRAMFS), "-append", KERNEL_WORDS,
        *_share("/", "host", "readonly=on,multidevs=remap"),
        *_share(results, "results"),
    ]  # fmt: skip


def _share(folder: Path | str, tag: str, more: str = "") -> tuple[str, str]:
    """A folder of this machine's, which the guest mounts by its tag."""
    return "-virtfs", f"local,path={folder},mount_tag={tag},security_model=none" + (more and f",{more}")

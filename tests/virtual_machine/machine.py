"""The emulated machine, seen from outside: what it needs, and one boot of it.

QEMU emulates the processor too (no KVM), so that it runs wherever it is installed. The guest sees this machine's root
read-only and runs a program of this checkout in this interpreter's environment; what it finds it writes to a folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import shutil
import subprocess
import sys
from compileall import compile_dir
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hapticd.sim.rigprocess import RigProcess

QEMU = "qemu-system-x86_64"
FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
KERNEL = ROOT / "build/virtual_machine/vmlinuz"
INITRAMFS = ROOT / "build/virtual_machine/initramfs.img"
UDEVD = Path("/lib/systemd/systemd-udevd")
PROCESSOR = "Nehalem,+rdrand"  # what wheels ask for; without AVX, for emulated it is slower than doing without
BOOT_S = 600.0  # with everything in it a boot took 88 s to 240 s on two cores that others used as well
_TAIL = 4000


def missing() -> str | None:
    """Why no guest can run here, in one sentence; None where it can."""
    if platform.machine() != "x86_64":
        return f"the guest runs this machine's own Python on an x86_64 kernel, and this is {platform.machine()}"
    if shutil.which(QEMU) is None:
        return f"{QEMU} is not installed (Debian: qemu-system-x86)"
    if not UDEVD.exists():
        return f"{UDEVD} is not there (Debian: udev)"
    if not all(file.is_file() for file in (KERNEL, INITRAMFS)):
        return "there is no guest: tests/virtual_machine/make_guest.sh makes it (Debian: busybox-static, cpio, kmod)"
    if INITRAMFS.stat().st_mtime < max((FOLDER / name).stat().st_mtime for name in ("make_guest.sh", "init.sh")):
        return "the guest is older than its recipe: run tests/virtual_machine/make_guest.sh again"
    return None


@dataclass(frozen=True, slots=True)
class Boot:
    """What came of one boot: a file for each step in `results`, and all that the guest's console said."""

    results: Path
    console: str

    def step(self, name: str) -> Any:
        """What a step of the guest's program found. AssertionError with its traceback and the console if it failed."""
        file = self.results / f"{name}.json"
        if not file.is_file():
            raise AssertionError(f"the guest never came to the step {name}; its console:\n{self.console[-_TAIL:]}")
        step = json.loads(file.read_text(encoding="utf-8"))
        if step["error"] is not None:
            raise AssertionError(
                f"the guest's step {name} failed:\n{step['error']}\nits console:\n{self.console[-_TAIL:]}"
            )
        return step["found"]


def boot(program: Path, results: Path) -> Boot:
    """Boot, run `program` to its end, power off. A guest that hangs is killed: what it had found by then counts."""
    compile_dir(str(ROOT / "hapticd"), quiet=1)  # the guest cannot keep what it compiles, and is slow at it
    console = results / "console"
    with RigProcess("rest", 1) as rig, console.open("wb") as file:
        command = _command(program, results, rig.directory)
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file) as machine:
            for process in (machine, rig.process):  # what is slow already must not wait for other programs, if it may
                with contextlib.suppress(PermissionError):
                    os.setpriority(os.PRIO_PROCESS, process.pid, -10)
            try:
                machine.wait(BOOT_S)
            except subprocess.TimeoutExpired:
                file.write(f"\nkilled after {BOOT_S:.0f} s\n".encode())
            finally:
                machine.kill()  # if it is still there: an interrupted test leaves no machine behind
    return Boot(results, console.read_text(encoding="utf-8", errors="replace"))


def _command(program: Path, results: Path, rig: Path) -> list[str]:
    """The second serial port is the rig's board: simulated outside, for there it keeps up with real time."""
    words = "console=ttyS0 quiet panic=-1"
    words += f" GUEST_PYTHON={sys.executable} GUEST_PROGRAM={program} GUEST_RIG={rig}"
    return [
        QEMU, "-accel", "tcg", "-cpu", PROCESSOR, "-smp", "2", "-m", "1024", "-nodefaults", "-no-reboot",
        "-display", "none", "-monitor", "none", "-serial", "stdio", "-serial", str((rig / "board").resolve()),
        "-kernel", str(KERNEL), "-initrd", str(INITRAMFS), "-append", words,
        "-virtfs", "local,path=/,mount_tag=host,security_model=none,readonly=on,multidevs=remap",
        "-virtfs", f"local,path={results},mount_tag=results,security_model=none",
    ]  # fmt: skip

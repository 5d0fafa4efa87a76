"""The emulated machine, seen from outside: what it needs, and one boot of it.

QEMU emulates the processor too (no KVM), so that it runs wherever it is installed. The guest sees this machine's root
read-only and runs a program of this checkout in this interpreter's environment; what it finds it writes to a folder.
"""

from __future__ import annotations

import json
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

QEMU = "qemu-system-x86_64"
FOLDER = Path(__file__).parent
GUEST = FOLDER.parents[1] / "build" / "virtual_machine"
BOOT_S = 400.0  # a boot and everything in it take a quarter of it on two idle cores
_TAIL = 4000


def missing() -> str | None:
    """Why no guest can run here, in one sentence; None where it can."""
    if platform.machine() != "x86_64":
        return f"the guest runs this machine's own Python on an x86_64 kernel, and this is {platform.machine()}"
    if shutil.which(QEMU) is None:
        return f"{QEMU} is not installed (Debian: qemu-system-x86)"
    if not (GUEST / "initramfs.img").is_file() or not (GUEST / "vmlinuz").is_file():
        return "there is no guest: tests/virtual_machine/make_guest.sh makes it (Debian: busybox-static, cpio, kmod)"
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
    words = f"console=ttyS0 quiet panic=-1 guest_python={sys.executable} guest_program={program}"
    shares = (
        f"local,path=/,mount_tag=host,{_SHARE},readonly=on,multidevs=remap",
        f"local,path={results},mount_tag=results,{_SHARE}",
    )
    command = [QEMU, *_MACHINE, "-kernel", str(GUEST / "vmlinuz"), "-initrd", str(GUEST / "initramfs.img")]
    command += ["-append", words, *(part for share in shares for part in ("-virtfs", share))]
    console = results / "console"
    with console.open("wb") as file:
        try:
            subprocess.run(command, stdin=subprocess.DEVNULL, stdout=file, stderr=file, timeout=BOOT_S, check=False)
        except subprocess.TimeoutExpired:
            file.write(f"\nkilled after {BOOT_S:.0f} s\n".encode())
    return Boot(results, console.read_text(encoding="utf-8", errors="replace"))


_SHARE = "security_model=none"
_MACHINE = (
    "-accel", "tcg", "-cpu", "max", "-smp", "2", "-m", "1024",
    "-nographic", "-no-reboot", "-nodefaults", "-serial", "stdio", "-monitor", "none",
)  # fmt: skip

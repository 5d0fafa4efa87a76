"""An ELF image for the board, built by firmware/Makefile: what lies where, and what each instruction is."""

from __future__ import annotations

import fcntl
import re
import shutil
import struct
import subprocess
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FIRMWARE = Path(__file__).parents[3] / "firmware"
CROSS = "arm-none-eabi-"
MISSING = None if shutil.which(f"{CROSS}gcc") else "arm-none-eabi-gcc is not installed"

_LOAD_SEGMENT = 1
_SYMBOL = re.compile(r"^([0-9a-f]{8}) . (\S+)$", re.MULTILINE)
_INSTRUCTION = re.compile(r"^ *([0-9a-f]{1,8}):\t((?:[0-9a-f]{4} ?)+) *\t(\S+)(?:\t([^;@\n]*))?", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Instruction:
    """One line of the disassembly; `size` in bytes."""

    mnemonic: str
    operands: str
    size: int


@dataclass(frozen=True, slots=True)
class Image:
    """`segments` as (load address, bytes), `symbols` by name, `instructions` by address."""

    path: Path
    segments: tuple[tuple[int, bytes], ...]
    symbols: dict[str, int]
    instructions: dict[int, Instruction]


def _tool(name: str, *arguments: str | Path) -> str:
    return subprocess.run([f"{CROSS}{name}", *arguments], check=True, capture_output=True, text=True).stdout


def _segments(elf: bytes) -> tuple[tuple[int, bytes], ...]:
    (headers_at,) = struct.unpack_from("<I", elf, 28)
    size, count = struct.unpack_from("<HH", elf, 42)
    found = []
    for i in range(count):
        kind, offset, _, load_at, n = struct.unpack_from("<IIIII", elf, headers_at + i * size)
        if kind == _LOAD_SEGMENT and n > 0:
            found.append((load_at, elf[offset : offset + n]))
    return tuple(found)


def _instructions(path: Path) -> dict[int, Instruction]:
    return {
        int(address, 16): Instruction(mnemonic, (operands or "").strip(), 2 * len(code.split()))
        for address, code, mnemonic, operands in _INSTRUCTION.findall(_tool("objdump", "--disassemble", path))
    }


def _make(*arguments: str | Path) -> None:
    subprocess.run(["make", "-s", "-C", FIRMWARE, *arguments], check=True, capture_output=True)


@cache
def build(board: str, modes: int, control_hz: int = 2000, setup: str = "", core: str = "m4") -> Image:
    """The image of a board for this number of modes, at this control rate, built in a directory of its own.

    The core is that of `make firmware`: no setup changes it, and compiling it takes three quarters of the time.
    """
    asked = (f"BOARD_MODES={modes}", f"SETUP=-DCONTROL_HZ={control_hz} {setup}")
    return _built(f"{board}.elf", f"{core}-{modes}modes", *asked)


def _built(name: str, core_name: str, *variables: str) -> Image:
    folder = Path(tempfile.mkdtemp(prefix="hapticd-m4-"))
    target = folder / name
    core = FIRMWARE / f"build/libhapticd-{core_name}.a"
    with (FIRMWARE / "Makefile").open() as makefile:
        fcntl.flock(makefile, fcntl.LOCK_EX)  # one of all test processes builds it
        _make(core.relative_to(FIRMWARE))
    shutil.copy2(core, folder)
    chip = core_name.partition("-")[0]  # what it was made of, without which it would be made again
    shutil.copytree(core.parent / chip, folder / chip)
    _make(f"BUILD={folder}", *variables, target)
    symbols = {name: int(address, 16) for address, name in _SYMBOL.findall(_tool("nm", target))}
    image = Image(target, _segments(target.read_bytes()), symbols, _instructions(target))
    shutil.rmtree(folder)
    return image

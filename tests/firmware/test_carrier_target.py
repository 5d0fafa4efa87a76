"""The signal chain as compilers make it: one table for all, and inner loops that a Cortex-M4 has the time for."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware"
MAKEFILE = (FIRMWARE / "Makefile").read_text()
CORTEX_M4 = tuple(re.search(r"^M4 := (.+)$", MAKEFILE, re.MULTILINE)[1].split())  # type: ignore[index]
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror")


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("objects")


def needs(*programs: str) -> None:
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def compiled(compiler: str, name: str, directory: Path, *flags: str) -> Path:
    """The object of one source of the core."""
    out = directory / f"{name}-{compiler}.o"
    if not out.exists():
        source = str(FIRMWARE / "core" / f"{name}.c")
        subprocess.run([compiler, *FLAGS, *flags, "-DHD_MODES=2", "-c", source, "-o", str(out)], check=True)
    return out


def constants(objcopy: str, compiler: str, directory: Path, *flags: str) -> bytes:
    needs(compiler, objcopy)
    out = directory / f"{compiler}.bin"
    source = compiled(compiler, "sine", directory, *flags)
    subprocess.run([objcopy, "-O", "binary", "-j", ".rodata", str(source), str(out)], check=True)
    return out.read_bytes()[: 4 * 8192]


def loops(disassembly: str) -> dict[str, list[str]]:
    """By function, the instructions of the innermost loop with the most multiplications."""
    found: dict[str, list[str]] = {}
    for name, body in re.findall(r"<(\w+)>:\n((?:.+\n)+)", disassembly):
        lines = [(int(at, 16), text) for at, text in re.findall(r"^ *([0-9a-f]+):\t(.+)$", body, re.MULTILINE)]
        for end, text in lines:
            back = re.match(r"b\w\w(?:\.\w)?\s+([0-9a-f]+)", text)
            if back and int(back[1], 16) < end:
                inside = [line for at, line in lines if int(back[1], 16) <= at <= end]
                if products(inside) > products(found.get(name, [])):
                    found[name] = inside
    return found


def products(instructions: list[str]) -> int:
    return sum(line.startswith(("smla", "mla")) for line in instructions)


@pytest.mark.parametrize(
    ("objcopy", "compiler", "flags"),
    [("objcopy", "clang", ()), ("arm-none-eabi-objcopy", "arm-none-eabi-gcc", CORTEX_M4)],
)
def test_every_compiler_makes_the_same_table(
    objcopy: str, compiler: str, flags: tuple[str, ...], objects: Path
) -> None:
    reference = constants("objcopy", "gcc", objects)
    assert len(reference) == 4 * 8192
    assert constants(objcopy, compiler, objects, *flags) == reference


def test_a_sample_of_both_modes_costs_ten_instructions_out_and_seven_and_a_half_in(objects: Path) -> None:
    """At 1 MHz each instruction is 0.6 % of a Cortex-M4 at 168 MHz: a loop that spills registers shows here first."""
    needs("arm-none-eabi-gcc", "arm-none-eabi-objdump")
    source = compiled("arm-none-eabi-gcc", "carrier", objects, *CORTEX_M4)
    shown = ["arm-none-eabi-objdump", "-d", "--no-show-raw-insn", str(source)]
    by_function = loops(subprocess.run(shown, check=True, capture_output=True, text=True).stdout)
    out, into = by_function["hd_carrier_speak"], by_function["hd_carrier_listen"]
    assert len(out) / (products(out) / 2) <= 10.0  # two products to a sample of both modes
    assert len(into) / (products(into) / 2) <= 7.5  # two: neighbours are added up before four of them
    assert sum("[sp" in line for line in into) <= 1  # the loop's end, once in ten samples


def test_the_chain_calls_nothing_but_itself_and_copies_of_memory(objects: Path) -> None:
    """No double, no 64-bit division and no libm: `__aeabi_` calls would be among the undefined names."""
    needs("arm-none-eabi-gcc", "arm-none-eabi-nm")
    for name, allowed in (("carrier", {"memset", "memcpy", "fabsf"}), ("sine", set())):
        source = compiled("arm-none-eabi-gcc", name, objects, *CORTEX_M4)
        listed = subprocess.run(["arm-none-eabi-nm", "-u", str(source)], check=True, capture_output=True, text=True)
        names = {line.split()[-1] for line in listed.stdout.splitlines()}
        assert {called for called in names if not called.startswith("hd_")} <= allowed

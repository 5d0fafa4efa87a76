"""Layers of a board's program: registers, drivers, board, program, interrupts. Calls lead down only, never round."""

from __future__ import annotations

import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).parents[2] / "firmware"
LAYERS = {
    "drivers": {"wait", "planar", "framed", "chip", "clock", "kept"},
    "board": {"sampling", "link", "crash", "board"},
    "program": {"main"},
    "interrupts": {"tick", "interrupts", "startup"},
}
LAYER_OF = {name: at for at, names in enumerate(LAYERS.values()) for name in names}
DEFINITION = re.compile(r"^(?!static)\w[\w *()]*?\b(\w+)\([^;{]*\)\n\{", re.MULTILINE)


def calls(board: str) -> dict[str, set[str]]:
    """The files that each file of a board's program calls, by the names of functions in their text."""
    paths = [FIRMWARE / "main.c", *(FIRMWARE / "boards/stm32").glob("*.c"), *(FIRMWARE / "boards" / board).glob("*.c")]
    texts = {path.stem: re.sub(r"/\*.*?\*/", "", path.read_text("utf-8"), flags=re.DOTALL) for path in paths}
    home = {function: stem for stem, text in texts.items() for function in DEFINITION.findall(text)}
    return {
        stem: {home[word] for word in re.findall(r"\w+", text) if word in home} - {stem} for stem, text in texts.items()
    }


@pytest.mark.parametrize("board", ["stm32f405", "stm32g474", "stm32h743"])
def test_no_file_of_a_boards_program_calls_a_higher_layer_or_back(board: str) -> None:
    found = calls(board)
    up = [(caller, it) for caller, called in found.items() for it in called if LAYER_OF[it] > LAYER_OF[caller]]
    assert up == []
    assert len([*TopologicalSorter(found).static_order()]) == len(found)
    assert {"tick", "main"} <= found["interrupts"], "as an example, that calls are found"

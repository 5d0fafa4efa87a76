"""Use of each pin of a board, read from the board's own sources."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

BOARDS = Path(__file__).parents[1] / "boards"
SHARED = "stm32"

# The converters' channels (DS8626, DS12288, DS12110: pin definitions); those of DAC3 by operational amplifiers.
ADC_PINS = {
    "stm32f405": {("1", 1): "PA1", ("2", 2): "PA2"},
    "stm32g474": {("1", 1): "PA0", ("2", 2): "PA1", ("3", 12): "PB0", ("4", 5): "PB15", ("5", 2): "PA9"},
    "stm32h743": {("1", 2): "PF11", ("1", 6): "PF12", ("1", 15): "PA3"}
    | {("2", 2): "PF13", ("2", 5): "PB1", ("2", 10): "PC0", ("3", 4): "PF5", ("3", 6): "PF10"},
}
DAC_PINS = {("1", "1"): "PA4", ("1", "2"): "PA5", ("2", "1"): "PA6", ("3", "2"): "PB1", ("3", "1"): "PB11"}

# The NUCLEO-64's headers (UM2505): Arduino's name, or the place on CN10.
_NUCLEO_64 = {
    "PA0": "A0",
    "PA1": "A1",
    "PA4": "A2",
    "PB0": "A3",
    "PA5": "D13",
    "PA6": "D12",
    "PB10": "D6",
    "PA2": "to the ST-LINK",
    "PA3": "to the ST-LINK",
    "PB1": "CN10-24",
    "PB12": "CN10-16",
    "PB13": "CN10-30",
    "PB15": "CN10-26",
    "PB11": "CN10-18",
    "PA9": "D8",
    "PC6": "CN10-4",
    "PC7": "D9",
}
# The NUCLEO-144's (UM2407, and public board files of others): Arduino's and the Zio connectors' names.
_NUCLEO_144 = {
    "PA3": "A0",
    "PC0": "A1",
    "PB1": "A3",
    "PF10": "A5",
    "PF5": "A7",
    "PF11": "morpho",
    "PF12": "morpho",
    "PF13": "morpho",
    "PA5": "D13",
    "PA6": "D12",
    "PB5": "D11",
    "PC10": "D45",
    "PC12": "D47",
    "PB10": "D36",
    "PB12": "D19",
    "PB13": "D18",
    "PC6": "D16",
    "PC7": "D21",
    "PD8": "to the ST-LINK",
    "PD9": "to the ST-LINK",
}
# What a board's headers are called, and where its pins are.
HEADERS = {"stm32g474": ("NUCLEO-64", _NUCLEO_64), "stm32h743": ("NUCLEO-144", _NUCLEO_144)}


@dataclass(frozen=True)
class Pin:
    """A pin and what it is for."""

    name: str
    purpose: str


def boards() -> list[str]:
    """Return the boards that have an image."""
    return sorted(path.parent.name for path in BOARDS.glob("*/link.ld"))


def pins(board: str) -> list[Pin]:
    """Return a board's pins: converters, line, its own inputs, and what all boards share. Raises ValueError."""
    chip = (BOARDS / board / "chip.c").read_text(encoding="utf-8")
    found = [*_converters(board, chip), *_line(chip)]
    files = f"{SHARED}/sampling.c", f"{SHARED}/sampling.h", f"{board}/chip.c", f"{board}/registers.h"
    for source in (BOARDS / file for file in files):
        found += _named(source.name, source.read_text(encoding="utf-8"))
    names = [pin.name for pin in found]
    if len(found) < 9 or len(set(names)) < len(names):
        raise ValueError(f"{board}: the pins in its sources are not understood: {', '.join(names)}.")
    return found


def _converters(board: str, chip: str) -> list[Pin]:
    sequences = re.findall(r"sensors_(\d)\[\w*\] = \{([\d, ]+)\}", chip)
    if sequences:  # several sensors to an ADC, and DACs beyond the board
        wired = [(adc, channel) for adc, row in sequences for channel in row.split(",")]
        return [
            Pin(ADC_PINS[board][adc, int(channel)], f"ADC{adc}: sensor of mode {at}")
            for at, (adc, channel) in enumerate(wired)
        ]
    lanes = re.findall(r"\{ADC(\d), (\d+), \w+, \w+, &DAC(\d)->DHR12R(\d)\}", chip)
    if not lanes:  # a pair that one stream carries
        inputs = re.findall(r"#define ADC(\d)_PIN (\d+)", chip)
        lanes = [(adc, channel, "1", str(place)) for place, (adc, channel) in enumerate(inputs, 1)]
    drives = [
        Pin(DAC_PINS[dac, output], f"DAC{dac} {output}: drive of mode {at}")
        for at, (*_, dac, output) in enumerate(lanes)
    ]
    senses = [
        Pin(ADC_PINS[board][adc, int(channel)], f"ADC{adc}: sensor of mode {at}")
        for at, (adc, channel, *_) in enumerate(lanes)
    ]
    return drives + senses


def _line(chip: str) -> list[Pin]:
    body = chip[chip.index("void serial_start") :]
    port, *numbers = re.findall(r"GPIO([A-D])->MODER.*?ALTERNATE\((\d+)\) \| ALTERNATE\((\d+)\)", body)[0]
    ways = zip(numbers, ("to", "from"), strict=True)
    return [Pin(f"P{port}{number}", f"the line {way} the host") for number, way in ways]


def _named(name: str, source: str) -> list[Pin]:
    found = []
    for number, port, said, purpose in re.findall(r"#define [A-Z_]+ (\d+)\s+/\* P([A-F])(\d+), (.+?) \*/", source):
        if number != said or f"GPIO{port}" not in source:
            raise ValueError(f"{name}: pin {number} is called P{port}{said}.")
        found.append(Pin(f"P{port}{number}", purpose))
    return found

"""Run the benches in ngspice, and hold what they measure against bounds."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import inf

from netlist import HERE

BENCHES = ("sensor", "spark", "amplifier", "enable")
TIMEOUT_S = 120.0


class SimulationFailure(Exception):
    """A bench did not run, or measured less than it should; str(error) is a sentence."""


@dataclass(frozen=True)
class Bound:
    """A measure of a bench, or its range over the loads, and where it has to lie."""

    name: str
    least: float
    most: float
    unit: str
    text: str

    def values(self, measured: Mapping[str, float]) -> list[float]:
        """The measure's values over the loads, least first. Raises SimulationFailure."""
        found = sorted(value for name, value in measured.items() if re.fullmatch(rf"{self.name}(_[\d.]+n)?", name))
        if not found:
            raise SimulationFailure(f"bench_{self.name.partition('.')[0]}.cir does not measure {self.name}.")
        return found

    def holds(self, measured: Mapping[str, float]) -> bool:
        values = self.values(measured)
        return self.least <= values[0] and values[-1] <= self.most


_at_most, _at_least = partial(Bound, least=-inf), partial(Bound, most=inf)
BOUNDS = (
    Bound("sensor.gain_v_um", 0.17, 0.22, "V", "at the ADC per um of a sensor with 2.55 nC/um: 7.5 um fill the range"),
    Bound("sensor.phase_deg", -30.0, 0.0, "degrees", "at 29.375 kHz: what LOOP in `setup.h` gets"),
    _at_least("sensor.high_hz", least=90e3, unit="Hz", text="-3 dB, upper: loops of 300 Hz see a constant phase"),
    _at_most("sensor.low_hz", most=1000.0, unit="Hz", text="-3 dB, lower"),
    _at_least("sensor.image_db", least=20.0, unit="dB", text="less at the DAC's image of 970.6 kHz"),
    _at_least("sensor.hum_db", least=35.0, unit="dB", text="less at 50 Hz"),
    _at_most(
        "sensor.noise_nv", most=500.0, unit="nV/rtHz", text="at the ADC; 12 bits with 0.8 mV of their own have 1100"
    ),
    Bound("sensor.middle_v", 1.6, 1.7, "V", "at rest"),
    _at_most(
        "sensor.open_drive_v", most=0.01, unit="V", text="of an open lead next to 100 mm of a wire at 150 V (0.57 pF)"
    ),
    _at_most("sensor.open_mains_v", most=0.01, unit="V", text="of an open lead, 10 pF from the mains"),
    _at_least(
        "spark.lead_v", least=140.0, unit="V", text="peak on the lead: a contact of 10 Ohm with 150 V that lasts"
    ),
    _at_most("spark.input_top_v", most=3.8, unit="V", text="at the op-amp's input: 0.5 V above its supply"),
    _at_least("spark.input_bottom_v", least=-0.5, unit="V", text="below ground"),
    _at_most("spark.adc_top_v", most=3.6, unit="V", text="at the ADC pin"),
    _at_least("spark.adc_bottom_v", least=-0.3, unit="V", text="at the ADC pin"),
    _at_most("spark.rail_v", most=3.6, unit="V", text="of the analogue supply, whose regulator cannot sink"),
    _at_most("spark.clamp_ma", most=20.0, unit="mA", text="peak through a diode of the BAT54S"),
    _at_most("spark.series_w", most=1.0, unit="W", text="in each of R2 and R3 while it lasts: until fault 9, 60 ms"),
    _at_most("spark.bleed_w", most=1.5, unit="W", text="in R1, as long"),
    _at_most(
        "spark.discharge_lead_v",
        most=30.0,
        unit="V",
        text="on the lead that a patch of 5.2 nF at 150 V discharges into",
    ),
    _at_most("spark.discharge_top_v", most=3.8, unit="V", text="at the op-amp's input then"),
    _at_least("spark.discharge_bottom_v", least=-0.5, unit="V", text="the same, below ground"),
    Bound("amplifier.gain_still", 107.0, 113.0, "V/V", "from the DAC pin to a patch of 3.1 nF whose plate stands"),
    Bound("amplifier.gain", 99.0, 113.0, "V/V", "with a mode of 3.3 kOhm too, 1.35 to 7 nF"),
    Bound("amplifier.phase_deg", -40.0, 0.0, "degrees", "at 29.375 kHz, 1.35 to 7 nF: measure each channel"),
    _at_least("amplifier.image_db", least=30.0, unit="dB", text="less at 970.6 kHz"),
    _at_most("amplifier.peaking", most=1.2, unit="", text="the most above 60 kHz, of the gain at 29.375 kHz"),
    _at_least("amplifier.margin_deg", least=50.0, unit="degrees", text="of phase, the loop opened at its link"),
    Bound("amplifier.full_v", 137.0, 155.0, "V", "peak, at 1.364 V from the DAC (150 V asked)"),
    _at_most("amplifier.patch_ma", most=200.0, unit="mA", text="peak into 3.1 and 7 nF and a mode of 45 mA"),
    _at_most("amplifier.output_v", most=21.0, unit="V", text="peak at the LM3886, which has 21 V of its 24"),
    _at_most("amplifier.output_a", most=3.5, unit="A", text="peak from it: half its least limit"),
    _at_most("amplifier.output_slew_v_us", most=6.0, unit="V/us", text="that it needs; it has 8 at least"),
    _at_most("enable.before_v", most=1.0, unit="V", text="at the patch without pulses, the DAC at full size"),
    _at_most("enable.on_ms", most=1.0, unit="ms", text="from the first pulse to the drive"),
    _at_least("enable.least_q_v", least=3.0, unit="V", text="of the monostable between pulses of 2 kHz ticks"),
    Bound("enable.monostable_ms", 1.5, 3.0, "ms", "from the last pulse to its end"),
    _at_most(
        "enable.high_ms",
        most=4.0,
        unit="ms",
        text="from the last edge to below 42.4 V: a processor halted, the line high",
    ),
    _at_most("enable.low_ms", most=4.0, unit="ms", text="the same, the line low"),
    _at_most("enable.high_end_v", most=1.0, unit="V", text="at the patch afterwards"),
    _at_most("enable.low_end_v", most=1.0, unit="V", text="the same, the line low"),
    _at_least("enable.again_v", least=140.0, unit="V", text="when pulses come again"),
    _at_most("enable.stop_ms", most=1.0, unit="ms", text="from the emergency stop to below 42.4 V"),
    _at_most("enable.stop_end_v", most=1.0, unit="V", text="at the patch afterwards"),
)


def measured() -> dict[str, float]:
    """Return what all benches measure. Raises SimulationFailure."""
    found: dict[str, float] = {}
    for bench in BENCHES:
        found |= run(bench)
    return found


def run(bench: str) -> dict[str, float]:
    """Return what one bench measures. Raises SimulationFailure."""
    if shutil.which("ngspice") is None:
        raise SimulationFailure("ngspice is not installed (apt: ngspice).")
    command = ["ngspice", "-b", f"bench_{bench}.cir"]
    done = subprocess.run(command, cwd=HERE, capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    found = re.findall(r"(?m)^result (\S+) ([-+\d.Ee]+)\s*$", done.stdout)
    trouble = re.findall(r"(?mi)^.*(?:error|failed|no such).*$", done.stdout + done.stderr)
    if trouble or not found:
        raise SimulationFailure(f"bench_{bench}.cir: {trouble[0].strip() if trouble else 'nothing was measured'}")
    return {name: float(value) for name, value in found}


def beyond(values: Mapping[str, float]) -> list[str]:
    """Return a sentence for each measure that is beyond its bound."""
    return [
        f"{bound.name} is {said(bound, values)} {bound.unit}, and has to be {limits(bound)}: {bound.text}."
        for bound in BOUNDS
        if not bound.holds(values)
    ]


def said(bound: Bound, values: Mapping[str, float]) -> str:
    """Return a measure to three digits, or its range over the loads."""
    texts = dict.fromkeys(
        "0" if abs(value) < 1e-3 else f"{float(f'{value:.3g}'):.6g}" for value in bound.values(values)
    )
    return " .. ".join([*texts][:: max(len(texts) - 1, 1)])


def limits(bound: Bound) -> str:
    """Return where a measure has to lie."""
    if bound.least == -inf:
        return f"at most {bound.most:g}"
    return f"at least {bound.least:g}" if bound.most == inf else f"{bound.least:g} .. {bound.most:g}"

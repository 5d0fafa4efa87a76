"""Supplies, idle levels, interlocks, and the sensors at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from ...values import ComplexArray, FloatArray
from .findings import Diagnosis, Flaw, Judgement, PlateDesign

BOARD_V: Final = (3.2, 3.4)  # VDDA of a board with a regulator of 3 %
RAIL_V: Final = (22.5, 26.0)  # of either 24 V supply
IDLE_OFF_V: Final = 0.05  # from the middle of VDDA: 62 steps of a 12-bit converter
AMPLIFIER_FAULT, EMERGENCY_STOP, SUPPLY = 99, 100, 98  # events of a board's log
MAINS_HZ: Final = (50.0, 60.0)
MOST_NOISE_UM: Final = 0.001  # standard deviation of a component at 2 kHz: four times that of one step of 12 bits
OPEN_CIRCUITS: Final = {
    EMERGENCY_STOP: Diagnosis(
        "The board reads the emergency stop as pushed: PB15 (STM32G474 and STM32H743: PC7) is open. Wire it through "
        "the stop's closed contact to ground.",
        (Flaw.STOP_LINE,),
    ),
    AMPLIFIER_FAULT: Diagnosis(
        "The board reads an amplifier's fault: PB14 (STM32G474 and STM32H743: PC6) is open. The contact must be closed "
        "while all is well: a normally open one is the wrong way round.",
        (Flaw.FAULT_LINE,),
    ),
}
HUM_UM: Final = 0.0002  # amplitude of a line that is no noise any more
CLEAR: Final = 5.0  # times the noise of a line


@dataclass(frozen=True, slots=True)
class MeterReadings:
    """A technician's readings at rest; None: not measured. `idle_v` is the DC at each sensor's ADC pin."""

    board_v: float | None
    plus_v: float | None
    minus_v: float | None
    idle_v: tuple[float | None, ...]


@dataclass(frozen=True, slots=True)
class SensorsAtRest:
    """Sensors at rest (M,): standard deviation of each component without hum, and what the demodulation leaves of hum,
    `hum_frac` of that at the converter."""

    noise_um: FloatArray
    hum_um: FloatArray
    hum_hz: float
    hum_frac: float

    def hum(self, sensor: int) -> str:
        """Return a sensor's hum in words."""
        hum_um = float(self.hum_um[sensor])
        at_converter = f", {hum_um / self.hum_frac:.1f} um at the converter" if self.hum_frac >= 1e-4 else ""
        return f"{1e3 * hum_um:.1f} nm at {self.hum_hz:.0f} Hz{at_converter}"


def judge_supply(
    readings: MeterReadings, interlock: int | None, *, is_configured: bool, supply_fell: bool
) -> Judgement:
    """Judge supplies and idle levels. `interlock` is the log's event that forbids to drive now, None without one."""
    findings = [*_wrong_levels(readings)]
    if supply_fell and not findings:
        fell = "The board's log says that its 3.3 V fell below 2.9 V: check its supply."
        findings.append(Diagnosis(fell, (Flaw.SUPPLY_LOW,)))
    if interlock is not None:
        findings.append(OPEN_CIRCUITS[interlock])
    if not (is_configured or findings):
        refused = "The board refuses its own configuration: see `hapticd firmware info`, and flash again."
        findings.append(Diagnosis(refused))
    read = {"board, VDDA": readings.board_v, "supply, plus": readings.plus_v, "supply, minus": readings.minus_v}
    read |= {f"sensor {k}, at its ADC pin": value for k, value in enumerate(readings.idle_v)}
    figures = ((name, "not measured" if value is None else f"{value:.2f} V") for name, value in read.items())
    passed = "Supplies and idle levels are right, and both interlocks are closed."
    return Judgement(passed, tuple(findings), tuple(figures))


def _wrong_levels(readings: MeterReadings) -> Iterator[Diagnosis]:
    wrong = [
        f"{name} is {value:.2f} V, not {least:g} to {most:g}"
        for name, value, (least, most) in (
            ("3.3 V of the board", readings.board_v, BOARD_V),
            ("+24 V", readings.plus_v, RAIL_V),
            ("-24 V, its sign aside,", None if readings.minus_v is None else -readings.minus_v, RAIL_V),
        )
        if value is not None and not least <= value <= most
    ]
    if wrong:
        check = "check fuse, wires and setting of that supply"
        yield Diagnosis(f"The {'; the '.join(wrong)}: {check}.", (Flaw.SUPPLY_LOW,))
    middle_v = (3.3 if readings.board_v is None else readings.board_v) / 2.0
    for sensor, value in enumerate(readings.idle_v):
        if value is not None and abs(value - middle_v) > IDLE_OFF_V:
            yield Diagnosis(
                f"Sensor {sensor} rests at {value:.2f} V instead of {middle_v:.2f}: check R4 to the middle, C2 and the "
                "solder joints of its op-amp.",
                (Flaw.SENSOR_OFFSET,),
                (sensor,),
            )


def at_rest(t_board_us: FloatArray, measured_um: ComplexArray, design: PlateDesign) -> SensorsAtRest:
    """Return the figures of ticks at `t_board_us` (T,), unwrapped, with `measured_um` (T, M).

    A hum is a slope over a tick, and what the demodulation leaves of it, amplitude times 2 f_hum / f |cos(pi f T)|,
    turns against the carrier: in the laboratory's frame it is a line at the mains' frequency.
    """
    t_s = np.asarray(t_board_us, np.float64) * 1e-6
    turned = measured_um * np.exp(2j * math.pi * design.drive_hz * t_s)[:, None]
    best_hz, best_um = MAINS_HZ[0], np.zeros(measured_um.shape[1])
    cleaned = measured_um - measured_um.mean(axis=0)
    for hum_hz in MAINS_HZ:
        waves = np.exp(2j * math.pi * np.outer(t_s, (hum_hz, -hum_hz)))
        basis = np.column_stack([np.exp(2j * math.pi * design.drive_hz * t_s), waves])
        fitted = np.linalg.lstsq(basis, turned, rcond=None)[0]
        lines_um = np.abs(fitted[1:]).sum(axis=0)
        if lines_um.max() > best_um.max():
            best_hz, best_um = hum_hz, lines_um
            cleaned = turned - basis @ fitted
    noise_um = np.sqrt((np.abs(cleaned) ** 2).mean(axis=0) / 2.0)
    frac = 2.0 * best_hz / design.drive_hz * abs(math.cos(math.pi * design.drive_hz / design.control_hz))
    return SensorsAtRest(noise_um, best_um, best_hz, frac)


def judge_rest(rest: SensorsAtRest, design: PlateDesign, ticks: int) -> Judgement:
    """Judge sensors at rest: hum in one sensor is its lead, in several the bench's ground."""
    most_um = MOST_NOISE_UM * math.sqrt(max(design.control_hz / 2000.0, 1.0))
    floor_um = CLEAR * rest.noise_um * math.sqrt(2.0 / max(ticks, 1))
    hums = [int(k) for k in np.flatnonzero(rest.hum_um > np.maximum(HUM_UM, floor_um))]
    noisy = [int(k) for k in np.flatnonzero(rest.noise_um > most_um)]
    floating = hums if len(hums) == 1 else [k for k in hums if k in noisy]
    findings = [
        Diagnosis(
            f"Sensor {sensor} alone picks up the mains ({rest.hum(sensor)}): is its lead on, its screen grounded?",
            (Flaw.SENSOR_FLOATING,),
            (sensor,),
        )
        for sensor in floating
    ]
    if len(hums) > 1 and not floating:
        findings.append(
            Diagnosis(
                f"All of sensors {', '.join(map(str, hums))} hum ({rest.hum(hums[0])}): check the grounds' star, "
                "the screens and where mains transformers stand.",
                (Flaw.MAINS_HUM,),
            )
        )
    findings += [
        Diagnosis(
            f"Sensor {sensor} has {1e3 * rest.noise_um[sensor]:.1f} nm of noise, where {1e3 * most_um:.1f} are the "
            "most: is its lead on? Then check its screen, its ground, and C5 at the ADC pin.",
            (Flaw.SENSOR_NOISY, Flaw.SENSOR_FLOATING),
            (sensor,),
        )
        for sensor in noisy
        if sensor not in floating
    ]
    figures = [
        (f"sensor {k}", f"noise {1e3 * noise_um:.2f} nm, hum {1e3 * hum_um:.2f} nm")
        for k, (noise_um, hum_um) in enumerate(zip(rest.noise_um, rest.hum_um, strict=True))
    ]
    return Judgement("All sensors are quiet at rest.", tuple(findings), tuple(figures))


def interlock_of(events: tuple[int, ...]) -> int | None:
    """Return the newest event that an open circuit leaves, None without one."""
    return next((event for event in reversed(events) if event in OPEN_CIRCUITS), None)

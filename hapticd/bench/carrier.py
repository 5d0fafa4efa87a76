"""What the signal chain costs in accuracy: ways to demodulate a control tick, and tables to synthesise from.

Waves are those of 12-bit converters at 1 MHz. The firmware's own rows run its C; the others are its alternatives in
float64, which flatters them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from ..sim.board.carrier import SignalChain
from .tables import Table, finite_rows
from .timing import REPEATS, compare

Floats = npt.NDArray[np.float64]
Phasors = npt.NDArray[np.complex128]
Demodulator = Callable[[Floats, Floats], complex]  # angles (N,) and steps from mid-rail (N,) to the amplitude

DRIVE_HZ = 29205.0
UM_PER_LSB = 0.0039
AMPLITUDE_UM = 2.0
OFFSET_LSB = 20.0
TICK = 500  # samples at 2 kHz
FIRMWARE = "least squares (firmware)"
FIRMWARE_TABLE = "8192 rounded (firmware)"
TABLES = {
    "1024 truncated": (1024, 0.0, 2047),
    "1024 rounded": (1024, 0.5, 2047),
    "4096 truncated": (4096, 0.0, 16384),
    "4096 rounded": (4096, 0.5, 16384),
    FIRMWARE_TABLE: (8192, 0.5, 16384),
    "16384 rounded": (16384, 0.5, 16384),
}  # entries, what is added to the index before it is cut off, what stands for 1


def run(*, ticks: int = 200, repeats: int = REPEATS) -> tuple[Table, Table]:
    """Compare demodulators over `ticks` ticks, and tables over as many samples."""
    return demodulation(ticks=ticks, repeats=repeats), synthesis(samples=ticks * TICK)


def demodulation(*, ticks: int, repeats: int = REPEATS) -> Table:
    """Error and run time of ways to find the amplitude in one tick."""
    clean, noisy = (_Wave(ticks, noise_lsb) for noise_lsb in (0.0, 1.0))
    rows, calls = [], {}
    for name, demodulate in _demodulators(clean).items():
        errors = np.abs(demodulate(clean) - clean.amplitude_lsb) / abs(clean.amplitude_lsb)
        ripple_lsb = demodulate(noisy) - clean.amplitude_lsb
        calls[name] = (lambda call=demodulate: call(clean), ticks)
        rows.append(
            (
                name,
                {
                    "mean_error_frac": float(np.sqrt((errors**2).mean())),
                    "worst_error_frac": float(errors.max()),
                    "ripple_um": UM_PER_LSB * float(np.sqrt((np.abs(ripple_lsb) ** 2).mean())),
                },
            )
        )
    times = compare(calls, repeats)
    return Table(
        name="demodulation",
        title=f"firmware: demodulating {AMPLITUDE_UM:g} um from {TICK} samples with {OFFSET_LSB:g} steps of offset",
        default=FIRMWARE,
        rows=finite_rows([(name, {**times[name].figures(), **figures}) for name, figures in rows]),
        compared=("time_us", "mean_error_frac"),
        time="time_us",
        error="mean_error_frac",
        notes=(
            "error: without noise; ripple: rms with 1 step of noise, the error included",
            "time: one tick of one mode on this machine; the firmware's has two modes and ten calls from Python in it",
        ),
    )


def synthesis(*, samples: int) -> Table:
    """Error of sine tables, as a share of the amplitude, before the converter rounds."""
    step = SignalChain(DRIVE_HZ).step
    phases = step * np.arange(samples, dtype=np.int64) % (1 << 32)
    ideal = np.exp(2j * np.pi * phases / (1 << 32))
    rows = []
    for name, (entries, rounding, one) in TABLES.items():
        table = np.round(one * np.exp(2j * np.pi * np.arange(entries) / entries)) / one
        errors = np.abs(table[np.floor(phases * (entries / 2.0**32) + rounding).astype(np.int64) % entries] - ideal)
        mean, worst = float(np.sqrt((errors**2).mean())), float(errors.max())
        rows.append((name, {"entries_count": float(entries), "mean_error_frac": mean, "worst_error_frac": worst}))
    return Table(
        name="synthesis",
        title="firmware: sine tables of the oscillator",
        default=FIRMWARE_TABLE,
        rows=finite_rows(rows),
        compared=("mean_error_frac", "worst_error_frac"),
        error="mean_error_frac",
        notes=(f"a step of a 12-bit converter is {1 / 2047:.5f} of the largest amplitude",),
    )


class _Wave:
    """Whole ticks of one amplitude as a 12-bit ADC gives them, with the oscillator's angles."""

    def __init__(self, ticks: int, noise_lsb: float) -> None:
        self.step = SignalChain(DRIVE_HZ).step
        self.angles_rad = 2 * np.pi * (self.step * np.arange(ticks * TICK, dtype=np.int64) % (1 << 32)) / (1 << 32)
        self.amplitude_lsb = AMPLITUDE_UM / UM_PER_LSB * complex(math.cos(0.7), math.sin(0.7))
        wave = (self.amplitude_lsb * np.exp(1j * self.angles_rad)).real + OFFSET_LSB
        noise = noise_lsb * np.random.default_rng(1).standard_normal(len(wave))
        self.codes = np.clip(np.floor(wave + noise + 2048.5), 0, 4095).astype(np.uint16) << 4

    @property
    def rows(self) -> tuple[Floats, Floats]:
        """Angles and steps from mid-rail (ticks, 500)."""
        steps = (self.codes >> 4).astype(np.float64) - 2048.0
        return self.angles_rad.reshape(-1, TICK), steps.reshape(-1, TICK)


def _demodulators(like: _Wave) -> dict[str, Callable[[_Wave], Phasors]]:
    angles_rad = like.rows[0][0]
    first_gram = _columns(angles_rad).T @ _columns(angles_rad)

    def each(demodulate: Demodulator) -> Callable[[_Wave], Phasors]:
        return lambda wave: np.array([demodulate(a, x) for a, x in zip(*wave.rows, strict=True)])

    return {
        FIRMWARE: _firmware,
        "numpy.linalg.lstsq": each(_lstsq),
        "Gram matrix of one tick": each(lambda a, x: _amplitude(np.linalg.solve(first_gram, _columns(a).T @ x))),
        "without the offset": each(lambda a, x: _amplitude(np.linalg.lstsq(_columns(a)[:, :2], x, rcond=None)[0])),
        "mean of products": each(lambda a, x: 2.0 * complex(np.mean(x * np.exp(-1j * a)))),
        "same, offset removed": each(lambda a, x: 2.0 * complex(np.mean((x - x.mean()) * np.exp(-1j * a)))),
    }


def _firmware(wave: _Wave) -> Phasors:
    return SignalChain(DRIVE_HZ).measure(np.stack((wave.codes, wave.codes), axis=1))[:, 0].astype(np.complex128)


def _lstsq(angles_rad: Floats, steps: Floats) -> complex:
    return _amplitude(np.linalg.lstsq(_columns(angles_rad), steps, rcond=None)[0])


def _columns(angles_rad: Floats) -> Floats:
    return np.stack((np.cos(angles_rad), -np.sin(angles_rad), np.ones_like(angles_rad)), axis=1)


def _amplitude(solution: npt.NDArray[np.floating]) -> complex:
    return complex(solution[0], solution[1])

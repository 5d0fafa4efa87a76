"""Search for plates whose modes give whole fingertips contrast: size, thickness, material, drive, number of modes.

For each plate and drive frequency the modes nearest to the drive are driven, each within the amplitude that its
amplifier reaches so far from its resonance: reach sigma / |sigma + j delta|, sigma = pi f / Q. Random pairs of contacts
are solved as the daemon does (`contact_pairs`). A design counts by its contrast, less where the slipping finger gets
less than ENOUGH_SLIP_FRAC of its target: contrast without amplitude is of no use.

Left out: damping and detuning by fingers, the coupling of patches to modes, and supports. All plates have one reach,
although a lighter one moves more per volt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hapticd.core.solver.contacts import COLD_CALLS
from hapticd.values import FloatArray

from .contact_pairs import Shapes, contact_rms_um, contrast_bound, grams, random_fingers, settle, surfaces
from .free_plate import ModeShape, free_modes
from .glued_plate import Patch, glued_plate_modes
from .materials import Material

Q_FACTOR = 500.0
REACH_UM = 4.23  # of a mode at resonance with 150 V
RADIUS_MM = 5.0  # of a fingertip's contact at 0.2 .. 1 N (50 .. 150 mm2)
TARGET_UM = 1.0
ENOUGH_SLIP_FRAC = 0.75
FARTHEST_HZ = 180.0  # of a driven mode from the drive: an amplifier reaches a sixth there; the firmware controls 300
NEAR_HZ = 150.0  # of a design's drive, for one of its plates, once modulus and thickness are accounted for
STEP_HZ = 25.0  # of the searched drives, less than a mode's bandwidth of 58 Hz
SEARCH_PAIRS, JUDGE_PAIRS = 96, 1000
SEARCH_CALLS = 4  # of the descent
SEED = 1

Progress = Callable[[float], None]
Measure = Callable[[Sequence[ModeShape]], Shapes]  # from a plate's modes to the maps that a laboratory has of them


@dataclass(frozen=True, slots=True)
class Plate:
    """A free plate to be judged, with the patches that are glued to it."""

    size_mm: tuple[float, float]
    thickness_mm: float
    material: Material
    patches: tuple[Patch, ...] = ()

    def modes(self, band_hz: tuple[float, float]) -> list[tuple[float, ModeShape]]:
        """Return the modes in the band, lowest first. Raises ValueError."""
        if self.patches:
            return glued_plate_modes(self.size_mm, self.thickness_mm, self.material, self.patches, band_hz)
        return free_modes(self.size_mm, self.thickness_mm, self.material, band_hz)


@dataclass(frozen=True, slots=True)
class Drive:
    """What the amplifiers do, and what the fingers are asked."""

    q_factor: float = Q_FACTOR
    reach_um: float = REACH_UM
    radius_mm: float = RADIUS_MM
    target_um: float = TARGET_UM
    farthest_hz: float = FARTHEST_HZ

    def limits_um(self, frequency_hz: FloatArray, drive_hz: float) -> FloatArray:
        """Return the largest amplitude of each mode (M,)."""
        decay_1_s = math.pi * frequency_hz / self.q_factor
        return np.asarray(self.reach_um * decay_1_s / np.hypot(decay_1_s, 2.0 * math.pi * (frequency_hz - drive_hz)))


@dataclass(frozen=True, slots=True)
class ContactDesign:
    """A plate at one drive frequency, its driven modes nearest first, and what random pairs of contacts get.

    `slip_um` is the mean over pairs, `still_um` the RMS, `contrast` the ratio of RMS values; `contrast_median` and
    `contrast_tenth`, the tenth percentile, are over pairs, and so are those of `bound`, which no controller exceeds.
    """

    plate: Plate
    drive_hz: float
    frequency_hz: tuple[float, ...]
    shapes: tuple[ModeShape, ...]
    limits_um: tuple[float, ...]
    slip_um: float
    still_um: float
    contrast: float
    contrast_median: float
    contrast_tenth: float
    bound: float
    bound_tenth: float
    score: float

    @property
    def farthest_hz(self) -> float:
        """The distance of the farthest driven mode from the drive."""
        return max(abs(hz - self.drive_hz) for hz in self.frequency_hz)


class PlateModes:
    """A plate's modes in a band, with the Gram matrices of pairs of contacts. Raises ValueError."""

    def __init__(self, plate: Plate, band_hz: tuple[float, float], drive: Drive, pairs: int, seed: int = SEED) -> None:
        """Solve the plate's modes in the band, widened by `drive.farthest_hz`."""
        self.plate, self.drive = plate, drive
        self._places_mm = random_fingers(plate.size_mm, pairs, seed)
        modes = plate.modes((max(band_hz[0] - drive.farthest_hz, 0.0), band_hz[1] + drive.farthest_hz))
        self.frequency_hz = np.array([hz for hz, _ in modes])
        self.shapes = [shape for _, shape in modes]
        if modes:
            self._grams = np.moveaxis(grams(surfaces(self.shapes), self._places_mm, drive.radius_mm), 3, 0)

    def nearest(self, drive_hz: float, count: int) -> tuple[int, ...]:
        """Return the `count` modes nearest to the drive; fewer where no more are within `farthest_hz`."""
        away_hz = np.abs(self.frequency_hz - drive_hz)
        order = np.argsort(np.round(away_hz, 6), kind="stable")[:count]
        return tuple(order[away_hz[order] <= self.drive.farthest_hz].tolist())

    def best(self, band_hz: tuple[float, float], count: int, measure: Measure | None = None) -> ContactDesign | None:
        """Return all figures of the drive of the highest score that has `count` modes near it, or None; the drives are
        compared by the first SEARCH_PAIRS and fewer calls of the descent."""
        scores: dict[tuple[float, tuple[int, ...]], float] = {}
        for drive_hz in drives_hz(*band_hz).tolist():
            driven = self.nearest(drive_hz, count)
            if len(driven) == count:
                slip_um, still_um = self._rms_um(drive_hz, driven, SEARCH_CALLS, SEARCH_PAIRS)
                scores[drive_hz, driven] = _score(slip_um, still_um, self.drive.target_um)
        return self.judge(*max(scores, key=scores.__getitem__), measure) if scores else None

    def judge(self, drive_hz: float, driven: Sequence[int], measure: Measure | None = None) -> ContactDesign:
        """Return all figures of one drive and its modes, solved to the end on the maps that `measure` makes of them,
        without it on the modes themselves."""
        slip_um, still_um = self._rms_um(drive_hz, driven, measure=measure)
        limits_um = self._limits_um(drive_hz, driven)
        slipping, still = self._grams_of(driven)
        bound, _ = contrast_bound(slipping, still, limits_um)
        contrast = slip_um / still_um
        return ContactDesign(
            self.plate,
            drive_hz,
            tuple(self.frequency_hz[list(driven)].tolist()),
            tuple(self.shapes[mode] for mode in driven),
            tuple(limits_um.tolist()),
            float(slip_um.mean()),
            _rms(still_um),
            _rms(slip_um) / _rms(still_um),
            float(np.median(contrast)),
            float(np.quantile(contrast, 0.1)),
            float(np.median(bound)),
            float(np.quantile(bound, 0.1)),
            _score(slip_um, still_um, self.drive.target_um),
        )

    def _rms_um(
        self,
        drive_hz: float,
        driven: Sequence[int],
        calls: int = COLD_CALLS,
        pairs: int | None = None,
        measure: Measure | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        slipping, still = self._grams_of(driven, pairs)
        known = slipping, still
        if measure is not None:
            maps = measure([self.shapes[mode] for mode in driven])
            both = grams(maps, self._places_mm, self.drive.radius_mm)
            known = both[..., 0], both[..., 1]
        w_um = settle(known[0], known[1:], self.drive.target_um, self._limits_um(drive_hz, driven), calls)
        return contact_rms_um(slipping, w_um), contact_rms_um(still, w_um)

    def _grams_of(self, driven: Sequence[int], pairs: int | None = None) -> tuple[FloatArray, FloatArray]:
        slipping, still = (np.ascontiguousarray(part[np.ix_(driven, driven)][..., :pairs]) for part in self._grams)
        return slipping, still

    def _limits_um(self, drive_hz: float, driven: Sequence[int]) -> FloatArray:
        return self.drive.limits_um(self.frequency_hz[list(driven)], drive_hz)


def search(
    plates: Sequence[Plate],
    counts: Sequence[int],
    drive_hz: tuple[float, float],
    drive: Drive,
    *,
    pairs: int = JUDGE_PAIRS,
    seed: int = SEED,
    progress: Progress = lambda _: None,
) -> list[ContactDesign]:
    """Return each plate's best drive within `drive_hz` for each number of modes, the best design first.

    A plate that has fewer modes near any drive is left out. `progress` is called with the share that is done. Raises
    ValueError.
    """
    designs = []
    for done, plate in enumerate(plates):
        progress(done / len(plates))
        modes = PlateModes(plate, drive_hz, drive, pairs, seed)
        found = [modes.best(drive_hz, count) for count in counts]
        designs += [design for design in found if design is not None]
    return sorted(designs, key=lambda design: -design.score)


def best_near(
    design: ContactDesign, plate: Plate, drive: Drive, pairs: int = JUDGE_PAIRS, measure: Measure | None = None
) -> ContactDesign | None:
    """Return `plate`, which differs little from the design's, at its own best drive; None without enough modes there.

    It is solved on the maps that `measure` makes of its modes, without it on the modes themselves. Raises ValueError.
    """
    scale = plate.thickness_mm / design.plate.thickness_mm
    scale *= math.sqrt(plate.material.young_gpa / design.plate.material.young_gpa)
    band_hz = (design.drive_hz * scale - NEAR_HZ, design.drive_hz * scale + NEAR_HZ)
    return PlateModes(plate, band_hz, drive, pairs).best(band_hz, len(design.shapes), measure)


def drives_hz(low_hz: float, high_hz: float) -> FloatArray:
    """Return the searched drives from `low_hz` to `high_hz`."""
    return low_hz + STEP_HZ * np.arange(math.floor((high_hz - low_hz) / STEP_HZ + 1e-9) + 1, dtype=np.float64)


def _score(slip_um: FloatArray, still_um: FloatArray, target_um: float) -> float:
    enough_um = ENOUGH_SLIP_FRAC * target_um
    return _rms(slip_um) / _rms(still_um) * min(1.0, float(slip_um.mean()) / enough_um) ** 2


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))

"""A simulated rig with mistakes: wires, leads, supplies and interlocks between the plate and the firmware's own C.

Its carrier is simulated sample by sample, so that hum, offsets and clipping reach the board as they do on a bench. A
rig without mistakes differs from its design as a good one does: gains by 10 %, qualities by 15 %, frequencies by 40 Hz
together and 2 Hz each.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from carrier_board import CarrierBoard, Converters, Lead
from mistakes import DANGEROUS, Mistake

from hapticd.design.commissioning.findings import Diagnosis, Flaw
from hapticd.design.commissioning.rest import AMPLIFIER_FAULT, EMERGENCY_STOP
from hapticd.sim.bench import SUPPLIES_V, SimulatedBench
from hapticd.sim.board.board import FLAG_LIVE, Board, BoardTrace, PlateModel
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.world import board_config, plate_model
from hapticd.values import FloatArray

GAINS_FRAC, QUALITIES_FRAC, TOGETHER_HZ, EACH_HZ = 0.1, 0.15, 40.0, 2.0
LSB_V = 3.3 / 4096.0
METER_FRAC = 0.003  # of a reading, as a cheap meter has it
SCOPE_FRAC = 0.03


@dataclass(frozen=True, slots=True)
class _Sound:
    """How this rig differs from its design without any mistake."""

    gains: FloatArray
    decays: FloatArray
    detuned_hz: FloatArray

    @classmethod
    def of(cls, seed: int, plate: GroundTruth) -> _Sound:
        random = np.random.default_rng((seed, 7))
        modes, plate_modes = len(plate.w_limit_um), len(plate.decay_1_s)
        return cls(
            1.0 + random.uniform(-GAINS_FRAC, GAINS_FRAC, modes),
            np.full(plate_modes, 1.0 + random.uniform(-QUALITIES_FRAC, QUALITIES_FRAC)),
            random.uniform(-TOGETHER_HZ, TOGETHER_HZ) + random.uniform(-EACH_HZ, EACH_HZ, plate_modes),
        )


class FaultyRig(SimulatedBench):
    """A rig whose mistakes are mended where a verdict points, by a technician with a meter, and an oscilloscope or not.

    `is_driven_in_danger`: the loop was closed while a mistake with which it is unstable or blind was there.
    """

    def __init__(
        self, settings: PlateSettings, mistakes: Iterable[Mistake] = (), seed: int = 1, *, has_scope: bool = True
    ) -> None:
        self.mistakes, self.has_scope = list(mistakes), has_scope
        self.was_driven = self.is_driven_in_danger = False
        self._sound = _Sound.of(seed, GroundTruth(settings))
        self._errors = np.random.default_rng((seed, 11))
        super().__init__(settings, seed)

    def new_board(self, boot_id: int) -> Board:
        converters = Converters()
        config = board_config(self.plate, self.plate.w_limit_um)
        phase = converters.loop_phase_rad(config.drive_hz)
        board = CarrierBoard(
            self._model(),
            config=replace(config, loop_phase_rad=(phase,) * self.modes, drive=None, sense=None),
            seed=self._seed,
            boot_id=boot_id,
            converters=converters,
        )
        board.connect([self._lead(sensor) for sensor in range(self.modes)])
        return board

    def run(self) -> BoardTrace:
        trace = super().run()
        is_live = bool((trace.flags & FLAG_LIVE).any())
        self.was_driven |= is_live
        self.is_driven_in_danger |= is_live and any(one.cause in DANGEROUS for one in self.mistakes)
        return trace

    def found(self, causes: Iterable[Flaw], wires: tuple[int, ...]) -> list[Mistake]:
        """Return the mistakes that are of one of these causes and, if `wires` are named, at one of them."""
        named = set(causes)
        return [
            one
            for one in self.mistakes
            if one.cause in named and (not (wires and one.wires) or set(wires) & set(one.wires))
        ]

    def mend(self, findings: Sequence[Diagnosis]) -> bool:
        """Remove what is `found` there, with the board off; return whether anything was."""
        found = {one for finding in findings for one in self.found(finding.causes, finding.wires)}
        self.mistakes = [one for one in self.mistakes if one not in found]
        if found:
            self.boot()
        return bool(found)

    async def read_supply(self, place: int) -> float:
        """Return VDDA or a rail: the rails fall together, by a fuse or a wrong setting."""
        return self._read(SUPPLIES_V[place] * (self._size(Flaw.SUPPLY_LOW) if place else 1.0), METER_FRAC)

    async def read_idle(self, sensor: int) -> float:
        return self._read(SUPPLIES_V[0] / 2.0 + LSB_V * self._lead(sensor).offset_lsb, METER_FRAC)

    async def read_output(self, amplifier: int, asked_v: float) -> float | None:
        return self._read(asked_v * self.output_share(amplifier), SCOPE_FRAC) if self.has_scope else None

    def _read(self, value: float, error_frac: float) -> float:
        return value * (1.0 + float(self._errors.normal(0.0, error_frac)))

    def output_share(self, amplifier: int) -> float:
        """Return an amplifier's output over what is asked of it."""
        wrong = {one.cause: one for one in self.mistakes if amplifier in one.wires}
        sign = -1.0 if Flaw.AMPLIFIER_INVERTED in wrong else 1.0
        share = 0.5 if Flaw.DRIVES_SHORTED in wrong else 1.0
        return sign * share * (wrong[Flaw.AMPLIFIER_GAIN].size if Flaw.AMPLIFIER_GAIN in wrong else 1.0)

    def _has(self, cause: Flaw) -> bool:
        return any(one.cause is cause for one in self.mistakes)

    def _size(self, cause: Flaw, otherwise: float = 1.0) -> float:
        return next((one.size for one in self.mistakes if one.cause is cause), otherwise)

    def interlock(self) -> int:
        open_stop = self._has(Flaw.STOP_LINE) and self._size(Flaw.STOP_LINE) > 0.5
        is_bridged = self._has(Flaw.STOP_LINE) and not open_stop
        event = AMPLIFIER_FAULT if self._has(Flaw.FAULT_LINE) else 0
        if open_stop or (self.is_stop_pushed and not is_bridged):
            event = EMERGENCY_STOP
        return event

    def _model(self) -> PlateModel:
        model, sound = plate_model(self.plate), self._sound
        drives, senses = self._drives(), self._senses()
        shift = 2.0 * math.pi * (sound.detuned_hz + self._size(Flaw.DIMENSIONS, 0.0) * self.plate.frequency_hz)
        return replace(
            model,
            decay_1_s=model.decay_1_s * sound.decays * self._size(Flaw.GLUE),
            detuning_rad_s=model.detuning_rad_s + shift,
            gain_um_per_v_s=model.gain_um_per_v_s @ np.diag(sound.gains) @ drives,
            sensor=senses @ np.real(model.sensor),
            noise_um=0.0,
            amplifier_limit_v=model.amplifier_limit_v * self._size(Flaw.SUPPLY_LOW),
        )

    def _drives(self) -> FloatArray:
        """Return patches by amplifiers."""
        patches, wires = np.ones(self.modes), np.eye(self.modes)
        for one in self.mistakes:
            where = list(one.wires)
            if one.cause is Flaw.DRIVE_OPEN:
                wires[where] = 0.0
            elif one.cause is Flaw.DRIVES_SHORTED:
                wires[np.ix_(where, where)] = 0.5  # two amplifiers of equal resistance
            elif one.cause is Flaw.AMPLIFIERS_SWAPPED:
                wires[where] = wires[where[::-1]]
            elif one.cause in (Flaw.PATCH_CRACKED, Flaw.GLUE):
                patches[where] *= one.size if one.cause is Flaw.PATCH_CRACKED else 1.0 / one.size
        outputs = np.diag([1.0 if self._shorted_drive(k) else self.output_share(k) for k in range(self.modes)])
        return np.asarray(np.diag(patches) @ wires @ outputs)

    def _shorted_drive(self, k: int) -> bool:
        return any(one.cause is Flaw.DRIVES_SHORTED and k in one.wires for one in self.mistakes)

    def _senses(self) -> FloatArray:
        """Return converters by sensors."""
        wires = np.eye(self.modes)
        for one in self.mistakes:
            where = list(one.wires)
            if one.cause in (Flaw.SENSOR_OPEN, Flaw.SENSOR_FLOATING):
                wires[where] *= 0.0
            if one.cause is Flaw.SENSOR_FLOATING:
                wires[where, (where[0] + 1) % self.modes] = 0.05
            elif one.cause is Flaw.SENSORS_SHORTED:
                wires[np.ix_(where, where)] = 0.5  # two patches of equal capacitance
            elif one.cause is Flaw.SENSORS_SWAPPED:
                wires[where] = wires[where[::-1]]
            elif one.cause in (Flaw.SENSOR_INVERTED, Flaw.SENSOR_GAIN):
                wires[where] *= -1.0 if one.cause is Flaw.SENSOR_INVERTED else one.size
        return wires

    def _lead(self, sensor: int) -> Lead:
        lead = Lead(hum_lsb=self._size(Flaw.MAINS_HUM, 0.0))
        for one in self.mistakes:
            if sensor not in one.wires:
                continue
            if one.cause is Flaw.SENSOR_OFFSET:
                lead = replace(lead, offset_lsb=one.size)
            elif one.cause is Flaw.SENSOR_NOISY:
                lead = replace(lead, noise_lsb=one.size)
            elif one.cause is Flaw.SENSOR_FLOATING:
                lead = replace(lead, hum_lsb=one.size, noise_lsb=10.0, pickup_lsb_per_v=0.2)
            elif one.cause is Flaw.PREAMPLIFIER_CLIPS:
                lead = replace(lead, clip_lsb=one.size * self._largest_lsb(sensor))
        return lead

    def _largest_lsb(self, sensor: int) -> float:
        """Return the amplitude of a sound rig at a fifth of the voltage, in steps."""
        peak_um_per_v = self.plate.nominal_gain_um_per_v_s[sensor] / self.plate.nominal_decay_1_s[sensor]
        return float(peak_um_per_v * self.plate.settings.v_limit_v / 5.0 / Converters().um_per_lsb)

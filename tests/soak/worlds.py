"""Random worlds for the firmware's endurance: plates within their tolerances, fingers, and references.

The same seed gives the same world.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hapticd.config.sections import LEAST_MODES, MOST_MODES
from hapticd.sim.board.board import BoardConfig, PlateModel
from hapticd.sim.board.closed_loop import LIMIT_V, NOISE_UM
from hapticd.sim.plate.wirings import IDENTITY, PAPER, wiring
from hapticd.values import ComplexArray, FloatArray

RUN_S = 30.0
KINDS = tuple(
    (modes, name, control_hz)
    for modes, name in ((2, IDENTITY), (2, PAPER), (3, IDENTITY))
    for control_hz in (2000.0, 5000.0)
)
FAR_KINDS = tuple(
    (modes, IDENTITY, control_hz) for modes in range(LEAST_MODES, MOST_MODES + 1) for control_hz in (2000.0, 5000.0)
)
FAR_HZ = 300.0  # from the drive, that their modes may be
W_LIMIT_UM = 4.0
SCALES_UM = (0.05, 0.5, 2.0, 4.0, 6.0)  # the largest is beyond the limit, for the limiter to scale
FRAMES_S = (0.01, 0.02, 0.05)
KNOT_MS = 2.5

DAMPING = (0.5, 3.0)
DRIFT_HZ, APART_HZ, DRIFT_HZ_PER_S = 100.0, 20.0, 4.0  # the drive follows at 4 Hz/s
CROSSTALK, LOOP_PHASE_RAD = 0.05, 0.2
FINGERS = 2
FINGER_DECAY_1_S = 345.0  # of a moist, pressing fingertip; it detunes by up to half of that
STROKE_HZ = 5.0  # of the mode shapes under a finger at 10 to 20 cm/s

Reference = Callable[[float], ComplexArray]
Knots = list[tuple[float, ComplexArray]]


@dataclass(frozen=True)
class World:
    """One run's plate, board and fingers; `knots_at` gives a frame's knots for the instant (s) of its start."""

    kind: str
    plate: PlateModel
    config: BoardConfig
    touch: tuple[FloatArray, FloatArray, FloatArray]
    frame_s: float
    knots_at: Callable[[float], Knots]
    detuning_at: Callable[[float], FloatArray]


def draw(seed: int, seconds: float = RUN_S, *, far: bool = False) -> World:
    """Return the world of this run: its kind goes by the seed, all else is random.

    Modes far from the drive have loop phases of their own, each off by up to LOOP_PHASE_RAD; near ones share one.
    """
    random = np.random.default_rng(seed)
    kinds = FAR_KINDS if far else KINDS
    modes, name, control_hz = kinds[seed % len(kinds)]
    wires, reference = wiring(name, modes), BoardConfig()
    gain_um_per_v_s = np.full(modes, reference.gain_um_per_v_s[0])
    nominal_rad_s = np.linspace(reference.detuning_rad_s[0], reference.detuning_rad_s[1], modes)
    if far:
        nominal_rad_s = 2.0 * np.pi * random.uniform(-FAR_HZ, FAR_HZ, modes)
    config = BoardConfig(
        w_limit_um=(W_LIMIT_UM,) * modes,
        v_limit_v=LIMIT_V,
        control_hz=control_hz,
        decay_1_s=(reference.decay_1_s[0],) * modes,
        detuning_rad_s=tuple(nominal_rad_s),
        gain_um_per_v_s=tuple(wires.gain * gain_um_per_v_s),
        drive=wires.drive,
        sense=wires.sense,
    )
    detuning_at = _drift(random, np.array(config.detuning_rad_s))
    plate = PlateModel(
        decay_1_s=random.uniform(*DAMPING) * np.array(config.decay_1_s),
        detuning_rad_s=detuning_at(0.0),
        gain_um_per_v_s=np.diag(gain_um_per_v_s) @ wires.drives,
        sensor=wires.senses @ (np.eye(modes) + random.uniform(-CROSSTALK, CROSSTALK, (modes, modes))),
        noise_um=NOISE_UM,
        amplifier_limit_v=LIMIT_V,
        loop_phase_rad=_loop_phases(random, modes, own=far),
    )
    frame_s = float(random.choice(FRAMES_S))
    touch = _touch(random, round(seconds * control_hz), control_hz, modes)
    kind = f"{modes} modes, {'far' if far else name}, {control_hz / 1e3:g} kHz"
    return World(kind, plate, config, touch, frame_s, _references(random, modes, frame_s), detuning_at)


def _loop_phases(random: np.random.Generator, modes: int, *, own: bool) -> tuple[float, ...]:
    drawn = random.uniform(-LOOP_PHASE_RAD, LOOP_PHASE_RAD, modes if own else 1)
    return tuple(np.broadcast_to(drawn, modes).tolist())


def _drift(random: np.random.Generator, nominal_rad_s: FloatArray) -> Callable[[float], FloatArray]:
    """Detuning over time: all modes move at a constant speed and turn back at the ends of the range."""
    start_hz, speed_hz_s = random.uniform(-DRIFT_HZ, DRIFT_HZ), random.uniform(-DRIFT_HZ_PER_S, DRIFT_HZ_PER_S)
    own_rad_s = nominal_rad_s + 2.0 * np.pi * random.uniform(-APART_HZ, APART_HZ, len(nominal_rad_s))

    def detuning_at(t_s: float) -> FloatArray:
        folded_hz = abs((start_hz + speed_hz_s * t_s - DRIFT_HZ) % (4.0 * DRIFT_HZ) - 2.0 * DRIFT_HZ) - DRIFT_HZ
        return np.asarray(own_rad_s + 2.0 * np.pi * folded_hz)

    return detuning_at


def _touch(
    random: np.random.Generator, ticks: int, control_hz: float, modes: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mode shapes, decay and detuning at fingers that land, stroke or stay, and lift, each within one tick."""
    phi, decay_1_s, detuning_rad_s = np.zeros((ticks, FINGERS, modes)), *np.zeros((2, ticks, FINGERS))
    for finger in range(FINGERS):
        end = 0
        while end < ticks:
            start, end = end, end + round(random.uniform(0.1, 2.0) * control_hz)
            if random.random() < 0.4:  # lifted
                continue
            turns_hz = random.choice([0.0, 1.0]) * random.uniform(0.0, STROKE_HZ, modes)
            t_s = np.arange(min(end, ticks) - start)[:, np.newaxis] / control_hz
            phi[start:end, finger] = np.cos(2.0 * np.pi * (turns_hz * t_s + random.uniform(0.0, 1.0, modes)))
            decay_1_s[start:end, finger] = load_1_s = random.uniform(0.0, FINGER_DECAY_1_S)
            detuning_rad_s[start:end, finger] = load_1_s * random.uniform(-0.5, 0.5)
    return phi, decay_1_s, detuning_rad_s


def _references(random: np.random.Generator, modes: int, frame_s: float) -> Callable[[float], Knots]:
    """Scenes of 0.2 to 4 s, one after another, each drawn from SCENES."""
    scene, t_end_s = _pause(random, modes), 0.0
    after_ms = np.arange(0.0, 1e3 * frame_s + KNOT_MS, KNOT_MS)

    def knots_at(t_s: float) -> Knots:
        nonlocal scene, t_end_s
        if t_s >= t_end_s:
            scene = SCENES[random.integers(len(SCENES))](random, modes)
            t_end_s = t_s + random.uniform(0.2, 4.0)
        return [(ms, scene(t_s + 1e-3 * ms)) for ms in after_ms]

    return knots_at


def _amplitudes_um(random: np.random.Generator, modes: int) -> ComplexArray:
    """Amplitudes in phase, of one common phase, or each of its own."""
    phases_rad = random.uniform(0.0, 2.0 * np.pi, modes) * random.choice([0.0, 1.0])
    phases_rad = phases_rad if random.random() < 0.5 else phases_rad[0]
    return np.asarray(random.choice(SCALES_UM) * random.uniform(-1.0, 1.0, modes) * np.exp(1j * phases_rad))


def _pause(_: np.random.Generator, modes: int) -> Reference:
    return lambda _: np.zeros(modes, complex)


def _held(random: np.random.Generator, modes: int) -> Reference:
    w_um = _amplitudes_um(random, modes)
    return lambda _: w_um


def _steps(random: np.random.Generator, modes: int) -> Reference:
    """Any of 16 amplitudes at each multiple of 10 ms; between knots the board interpolates."""
    drawn = [_amplitudes_um(random, modes) for _ in range(16)]
    return lambda t_s: drawn[int(100.0 * t_s) % len(drawn)]


def _grating(random: np.random.Generator, modes: int) -> Reference:
    """A texture: the amplitude alternates at 5 to 200 Hz."""
    w_um, turn_rad_s = _amplitudes_um(random, modes), 2.0 * np.pi * random.uniform(5.0, 200.0)
    return lambda t_s: np.asarray(w_um * np.cos(turn_rad_s * t_s))


def _ridges(random: np.random.Generator, modes: int) -> Reference:
    """A texture: the amplitude jumps between two values, 2 to 60 times a second."""
    one_um, other_um = _amplitudes_um(random, modes), _amplitudes_um(random, modes)
    jumps_hz = random.uniform(2.0, 60.0)
    return lambda t_s: one_um if int(jumps_hz * t_s) % 2 else other_um


def _stroke(random: np.random.Generator, modes: int) -> Reference:
    """Each mode goes its own way, as for two fingers that move."""
    w_um = _amplitudes_um(random, modes)
    turns_hz, at = random.uniform(0.0, STROKE_HZ, modes), random.uniform(size=modes)
    return lambda t_s: np.asarray(w_um * np.cos(2.0 * np.pi * (turns_hz * t_s + at)))


SCENES = (_pause, _held, _steps, _grating, _ridges, _stroke)

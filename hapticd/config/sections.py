"""All configuration keys by section, each with default, bounds and meaning.

Validation, error messages and `hapticd run --print-config` all use these definitions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from .keys import key

SIMULATED = "sim"
LEAST_MODES, MOST_MODES = 2, 8  # with an amplifier each: boards are built for these
LEAST_CONTACT_MODES = 4  # one still and one slippery contact are four conditions (design/README.md)
HEADROOM_FRAC = 0.05  # of each limit at least is kept free
OVERSHOOT_FRAC = 0.01  # by which the plate passes a moving reference
SIGMAS = 3.0  # of the sensors, with all modes at their limits at once: the worst of 40 worlds stay within by 1 %
LEAST_REFERENCE_FRAC = 0.25  # of a limit, however little is known of the sensors

# Repeated from pads and simulation, which are not loaded when a configuration is checked; tests compare them.
PAD_NAMES = ("usbc-usb", "mt2-usb", "usbc-bt", "mt2-bt", "mt1")
TUIO_ADDRESS = "127.0.0.1:3333"
PLATE_NAMES = ("reference", "fingertip", "wide")
WIRING_NAMES = ("identity", "paper")
SCENARIO_NAMES = (
    "strokes",
    "guided",
    "circles",
    "rest",
    "swap",
    "virtual-finger",
    "paper-figure-10",
    "paper-figure-11",
    "step",
    "half-strokes",
    "both-slip",
    "three",
    "one-of-three",
    "two-of-three",
    "two-of-four",
    "two-of-five",
    "press",
    "hands",
)


@dataclass(frozen=True, slots=True)
class PlateConfig:
    """The glass plate and its measurements."""

    size_mm: tuple[float, ...] = key((137.5, 137.5), "width (x) and depth (y)", low=10, high=1000)
    modes_file: str = key("", "NPZ or CSV of the measured mode map; empty: the simulated plate's own map")
    friction_curve: tuple[float, ...] = key(
        (),
        "amplitude in um at equally spaced frictions 1 .. 0, rising from 0; empty: the built-in curve",
        low=0,
        high=100,
    )
    friction_floor_frac: float = key(
        0.057, "friction at the end of friction_curve, relative to bare glass", low=0.001, high=0.99
    )
    friction_speed_mm_s: float = key(
        0.0,
        "sliding speed at which a friction needs twice the amplitude of friction_curve; 0: speed changes nothing",
        low=0,
        high=100000,
    )


@dataclass(frozen=True, slots=True)
class TrackpadConfig:
    """The position sensor under the plate, and its placement."""

    source: str = key(
        SIMULATED,
        "source of touch reports; evdev: any multitouch device of Linux; tuio: a tracker, by TUIO 1.1 or 2.0 over UDP",
        choices=(SIMULATED, "hid", "evdev", "tuio", "replay"),
    )
    device: str = key(
        "",
        f"which one, by its source; hid: one of {', '.join(PAD_NAMES)}, empty: the connected one; evdev: path or name, "
        "empty: the first multitouch device; tuio: address and port to bind, empty: "
        f"{TUIO_ADDRESS}; replay: a recording of `libinput record`, `evemu-record` or `evtest`",
    )
    size_mm: tuple[float, ...] = key(
        (), "width and height of the device's range of positions; empty: as it says itself", low=1, high=5000
    )
    tuio_sender: str = key("", "address that the tracker's datagrams must come from; empty: this computer")
    offset_mm: tuple[float, ...] = key((0.0, 0.0), "the pad's centre in plate coordinates", low=-500, high=500)
    matrix: tuple[float, ...] = key(
        (1.0, 0.0, 0.0, 1.0),
        "rotation, mirroring, scale and shear of the pad on the plate as a 2 x 2 matrix xx, xy, yx, yy",
        low=-2,
        high=2,
    )
    ellipse_scale: float = key(
        0.0,
        "true mm of a contact's axes per mm of the ellipse that the pad reports; 0: contacts are discs of "
        "solver.contact_radius_mm",
        low=0,
        high=4,
    )
    ellipse_offset_mm: float = key(0.0, "true axes of a contact whose ellipse is reported as 0", low=-20, high=20)
    latency_ms: float = key(10.0, "delay from the finger's position to its report", low=0, high=50)


# Lag of the plate behind moving references under each law (`tests/firmware/test_control.py`).
LAW_DELAY_MS = {"pi": 1.0, "pi_ff": 0.0, "deadbeat": 0.0}


@dataclass(frozen=True, slots=True)
class DeviceConfig:
    """The board between the serial port and the amplifiers."""

    port: str = key(SIMULATED, 'serial port, such as /dev/ttyACM0; "sim": the simulated board')
    baud: int = key(921600, "serial speed", low=9600, high=5250000)
    controller: str = key("deadbeat", "control law on the board", choices=("pi", "pi_ff", "deadbeat"))
    calibration_file: str = key(
        "",
        "TOML of the measured modes, from `hapticd calibrate resonance`, against which modes and wires are tested "
        "before the plate is first driven; empty: the firmware's defaults, no test",
    )

    @property
    def plate_delay_ms(self) -> float:
        """Lag of the plate behind its reference."""
        return LAW_DELAY_MS[self.controller]


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """Amplitude limits of the amplifiers, applied here and again by the firmware."""

    w_limit_um: tuple[float, ...] = key((4.0, 4.0), "largest amplitude of each mode, peak to peak", low=0.01, high=20)


@dataclass(frozen=True, slots=True)
class PredictionConfig:
    """Prediction of finger positions."""

    period_ms: float = key(11.25, "the pad's nominal report period", low=2, high=50)
    pad_weights: tuple[float, ...] = key(
        (),
        "what `hapticd calibrate prediction` learned of the pad: weights of five corrections at 15 ms, then at 30 ms; "
        "empty: those of many pads",
        low=-8,
        high=8,
    )


@dataclass(frozen=True, slots=True)
class SolverConfig:
    """Solution for the modal amplitudes."""

    contact_radius_mm: float = key(
        5.0,
        "radius of a fingertip's contact, over which amplitudes count, on plates of four modes or more, where "
        "trackpad.ellipse_scale is 0 or the pad reports no ellipse; 0: a point",
        low=0,
        high=15,
    )


@dataclass(frozen=True, slots=True)
class UncertaintyConfig:
    """Standard deviations of what is taken to be known of plate, sensors and pad, for telemetry and the solver."""

    # The defaults are those of laboratories (`sim.world_tolerances`) after scan and sweep, where
    # `tests/daemon/test_felt_telemetry.py` compares what telemetry says with what is felt.
    map_frac: float = key(
        0.02,
        "of the mode map at each place, as a share of a shape's peak: noise, and change since its scan",
        low=0,
        high=1,
    )
    sensors_frac: float = key(0.02, "of the board's sensors: gain, phase (rad) and crosstalk of each", low=0, high=1)
    gain_frac: float = key(
        0.0,
        "of each sensor's gain, and of other modes in it, where the map may make up for it: only limits have room",
        low=0,
        high=1,
    )
    place_mm: float = key(
        0.9,
        "of a contact's centre on each axis: the pad's place and centroids, and what its size makes uncertain; 0: "
        "known, and trackpad.latency_ms and the person too",
        low=0,
        high=10,
    )


@dataclass(frozen=True, slots=True)
class ClientConfig:
    """Endpoints for clients."""

    tcp: str = key("", 'address for clients with a key, such as "192.168.7.1:7410"; takes 3 ports; empty: ipc only')
    keys_dir: str = key("", "directory of the keys for tcp, made by `hapticd service keys`")


@dataclass(frozen=True, slots=True)
class SimConfig:
    """The simulated rig, for trackpad and board on \"sim\"."""

    scenario: str = key(
        "strokes", f"of the simulated fingers: {', '.join(SCENARIO_NAMES)}, or a CSV or recording of fingers to play"
    )
    seed: int = key(1, "seed of fingers, noise and mode map", low=0, high=2**31 - 1)
    plate: str = key("reference", f"one of {', '.join(PLATE_NAMES)}, or a plate's file (.toml)")
    modes: int = key(0, "modes with an amplifier each; 0: the plate's own", low=0, high=MOST_MODES)
    wiring: str = key("identity", "of amplifiers and sensors to the modes", choices=WIRING_NAMES)
    rig_dir: str = key("", "directory of a running rig; empty: the daemon starts one")

    @property
    def fingers_file(self) -> str:
        """The file of the fingers, empty if they are those of a scenario."""
        return "" if self.scenario in SCENARIO_NAMES else self.scenario


@dataclass(frozen=True, slots=True)
class RealtimeConfig:
    """Real-time settings that the service requests of the kernel; its unit file permits them."""

    fifo_priority: int = key(
        0,
        "SCHED_FIFO priority of the loop, with its memory locked and processors kept out of sleep states while fingers "
        "are down, which costs heat; 0: ordinary scheduling",
        low=0,
        high=90,
    )
    processor: int = key(-1, "processor to which the loop is pinned; -1: any", low=-1, high=1023)


@dataclass(frozen=True, slots=True)
class RecordConfig:
    """Recording; see hapticd/tools/record/README.md."""

    file: str = key("", "MCAP file to record everything to, from each start on; an existing file is kept; empty: none")
    max_mb: int = key(512, "size of a file at which the next one begins; of one start 8 stay", low=1, high=1_000_000)
    telemetry_hz: int = key(
        0,
        "control ticks per second that the board reports, for `hapticd calibrate touch`: 500; 0: none",
        low=0,
        high=2000,
    )


@dataclass(frozen=True, slots=True)
class LogConfig:
    """Log output."""

    level: str = key("info", "lowest level that is logged", choices=("debug", "info", "warning", "error"))


@dataclass(frozen=True, slots=True)
class Config:
    """All sections, each as `[section]` in the file."""

    plate: PlateConfig = field(default_factory=PlateConfig)
    trackpad: TrackpadConfig = field(default_factory=TrackpadConfig)
    device: DeviceConfig = field(default_factory=DeviceConfig)
    limits: LimitsConfig = field(default_factory=LimitsConfig)
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    uncertainty: UncertaintyConfig = field(default_factory=UncertaintyConfig)
    client: ClientConfig = field(default_factory=ClientConfig)
    sim: SimConfig = field(default_factory=SimConfig)
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)
    record: RecordConfig = field(default_factory=RecordConfig)
    log: LogConfig = field(default_factory=LogConfig)

    @property
    def reference_limit_um(self) -> tuple[float, ...]:
        """The largest amplitude of each mode in a reference: so much below its limit that the plate stays within, by
        three sigmas, whatever share of all modes each sensor mistakes for its own, and however far its gain is off; a
        quarter of the limit at least."""
        limits, known = self.limits, self.uncertainty
        unseen_um = SIGMAS * known.sensors_frac * math.hypot(*limits.w_limit_um)
        least_share, most_share = LEAST_REFERENCE_FRAC, 1.0 - HEADROOM_FRAC
        return tuple(
            [
                limit_um * min(max(1.0 - OVERSHOOT_FRAC - unseen_frac, least_share), most_share)
                for limit_um in limits.w_limit_um
                for unseen_frac in (math.hypot(unseen_um / limit_um, SIGMAS * known.gain_frac),)
            ]
        )

    @property
    def rig_dir(self) -> str:
        """The directory of the simulated rig if the trackpad is simulated, else empty."""
        return self.sim.rig_dir if self.trackpad.source == SIMULATED else ""

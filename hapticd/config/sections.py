"""What can be configured, section by section.

Each key states its default, its bounds and its meaning beside it, so that the check, the error sentences and
`hapticd run --print-config` cannot disagree.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from .keys import key

SIMULATED = "sim"

# What the core and the simulation know by name, written down here too: a configuration is checked before they load.
SCENARIO_NAMES = (
    "strokes",
    "circles",
    "rest",
    "swap",
    "virtual-finger",
    "paper-figure-10",
    "paper-figure-11",
    "step",
    "both-slip",
    "hands",
)


@dataclass(frozen=True, slots=True)
class PlateConfig:
    """The glass plate and what was measured of it."""

    size_mm: tuple[float, ...] = key((137.5, 137.5), "width (x) and depth (y)", low=10, high=1000)
    modes_file: str = key("", "NPZ or CSV of the measured mode shapes; empty: the simulated plate's own cartography")
    parasitic_modes_file: str = key(
        "", "NPZ or CSV of the shapes of modes near the drive that only fingers drive; empty: none"
    )
    parasitic_detuning_hz: tuple[float, ...] = key(
        (), "how far each of them lies above the drive", low=-1000, high=1000
    )
    parasitic_decay_1_s: tuple[float, ...] = key((), "pi f / Q of each of them", low=1, high=10000)
    finger_decay_1_s: float = key(
        100.0, "what one finger on a peak of a mode adds to its decay, for parasitic_modes_file", low=0, high=2000
    )
    friction_curve: tuple[float, ...] = key(
        (),
        "amplitude in um at equally spaced frictions 1 .. 0, rising from 0; empty: the built-in curve",
        low=0,
        high=100,
    )


@dataclass(frozen=True, slots=True)
class TrackpadConfig:
    """The position sensor under the plate, and where it lies."""

    source: str = key(SIMULATED, "where reports come from", choices=(SIMULATED, "hid", "replay"))
    model: str = key(
        "auto",
        "what the reports are; auto: whichever pad is connected",
        choices=("auto", "mt1", "mt2-usb", "mt2-bt", "usbc-usb", "usbc-bt"),
    )
    replay_file: str = key("", 'recording to replay, for source = "replay"')
    offset_mm: tuple[float, ...] = key((0.0, 0.0), "the pad's centre on the plate", low=-500, high=500)
    rotation_deg: float = key(0.0, "the pad turned anticlockwise on the plate", low=-180, high=180)
    scale: tuple[float, ...] = key((1.0, 1.0), "true mm per pad mm along the pad's x and y", low=0.5, high=2)
    matrix: tuple[float, ...] = key(
        (), "rotation, scale and shear in one, rows of 2 x 2: xx, xy, yx, yy; empty: the two above", low=-2, high=2
    )
    latency_ms: float = key(10.0, "from the finger's position to the report", low=0, high=50)
    silence_ms: float = key(40.0, "fingers count as lifted when the pad is silent for so long", low=15, high=1000)


# By how much the plate lags each law on moving references, measured: `hapticd bench firmware`, table tracking.
LAW_DELAY_MS = {"pi": 1.0, "pi_ff": 0.0, "deadbeat": 0.0}


@dataclass(frozen=True, slots=True)
class DeviceConfig:
    """The board between the serial port and the amplifiers."""

    port: str = key(SIMULATED, 'serial port, such as /dev/ttyACM0; "sim": the simulated board')
    baud: int = key(921600, "serial speed", low=9600, high=5250000)
    link_ms: float = key(5.0, "start value of the one-way delay; then it is measured", low=0, high=40)
    loop_delay_ms: float = key(0.0, "by how much the plate follows later than its control law lets it", low=0, high=20)
    controller: str = key("deadbeat", "control law on the board", choices=("pi", "pi_ff", "deadbeat"))
    calibration_file: str = key(
        "", "TOML of the measured modes, as `hapticd firmware sweep --save` writes it; empty: the firmware's own"
    )

    @property
    def plate_delay_ms(self) -> float:
        """By how much the plate follows its reference late: the control law's own lag and `loop_delay_ms`."""
        return LAW_DELAY_MS[self.controller] + self.loop_delay_ms


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """What the amplifiers can give; held here and again by the firmware."""

    w_limit_um: tuple[float, ...] = key((4.0, 4.0), "largest amplitude of each mode, peak to peak", low=0.01, high=20)
    headroom_frac: float = key(
        0.02, "share of each limit that no reference asks for: the plate may overshoot it by so much", low=0, high=0.5
    )

    @property
    def reference_limit_um(self) -> tuple[float, ...]:
        """The largest amplitude of each mode that a reference may ask for."""
        return tuple([limit_um * (1.0 - self.headroom_frac) for limit_um in self.w_limit_um])


@dataclass(frozen=True, slots=True)
class PredictionConfig:
    """Where the fingers will be when the plate moves."""

    period_ms: float = key(11.25, "the pad's nominal report period", low=2, high=50)
    noise_mm: float = key(0.053, "position noise that the predictor assumes, per axis", low=0.001, high=1)


@dataclass(frozen=True, slots=True)
class SolverConfig:
    """How modal amplitudes are found."""

    fade: float = key(
        5.0,
        "mm2/um2: share of its target that a slipping finger must get for a slope of 1 um/mm under a still one, where "
        "a limit keeps it from more; else amplitude gives way; 0: it does not",
        low=0,
        high=100,
    )
    phase_rotation: bool = key(
        True, "two slipping fingers or more change their signs by turning their phase, and never feel it"
    )
    contact_radius_mm: float = key(
        0.0, "of a still finger's contact, over which its mean square is least; 0: a point", low=0, high=15
    )
    tolerance_um: float = key(
        0.02, "error allowed between knots, and by which a standing reference may be off", low=1e-4, high=1
    )
    max_knots: int = key(16, "knots in one reference frame", low=1, high=24)


@dataclass(frozen=True, slots=True)
class ClientConfig:
    """Where clients connect."""

    runtime_dir: str = key("", "directory of the ipc endpoints; empty: the service's or the user's runtime directory")
    tcp: str = key("", 'address for clients with a key, such as "192.168.7.1:7410"; takes 3 ports; empty: ipc only')
    keys_dir: str = key("", "directory of the keys for tcp, as `hapticd keys` makes it")


@dataclass(frozen=True, slots=True)
class SimConfig:
    """The simulated rig, for trackpad and board on \"sim\"."""

    scenario: str = key("strokes", "what the simulated fingers do", choices=SCENARIO_NAMES)
    seed: int = key(1, "of fingers, noise and cartography", low=0, high=2**31 - 1)
    rig_dir: str = key("", "directory of a rig that runs already; empty: the daemon starts one")


@dataclass(frozen=True, slots=True)
class RealtimeConfig:
    """What the service asks of the kernel; its unit file allows it."""

    fifo_priority: int = key(0, "SCHED_FIFO priority of the loop; 0: ordinary scheduling", low=0, high=90)
    processor: int = key(-1, "the one processor that the loop keeps to; -1: any", low=-1, high=1023)
    lock_memory: bool = key(False, "keep all that was once touched in memory")
    stay_awake: bool = key(False, "keep processors from sleeping while fingers are down; costs heat")


@dataclass(frozen=True, slots=True)
class RecordConfig:
    """Recording; see hapticd/tools/record/README.md."""

    file: str = key("", "MCAP file to record everything to, from each start on; an existing file is kept; empty: none")
    max_mb: int = key(512, "size of a file at which it ends", low=1, high=1_000_000)
    max_files: int = key(8, "files kept of one start: a full one is followed, the oldest removed", low=1, high=999)


@dataclass(frozen=True, slots=True)
class LogConfig:
    """What is said."""

    level: str = key("info", "least important line", choices=("debug", "info", "warning", "error"))


@dataclass(frozen=True, slots=True)
class Config:
    """All sections, each as `[section]` in the file."""

    plate: PlateConfig = field(default_factory=PlateConfig)
    trackpad: TrackpadConfig = field(default_factory=TrackpadConfig)
    device: DeviceConfig = field(default_factory=DeviceConfig)
    limits: LimitsConfig = field(default_factory=LimitsConfig)
    prediction: PredictionConfig = field(default_factory=PredictionConfig)
    solver: SolverConfig = field(default_factory=SolverConfig)
    client: ClientConfig = field(default_factory=ClientConfig)
    sim: SimConfig = field(default_factory=SimConfig)
    realtime: RealtimeConfig = field(default_factory=RealtimeConfig)
    record: RecordConfig = field(default_factory=RecordConfig)
    log: LogConfig = field(default_factory=LogConfig)

"""The configuration: TOML in, frozen values out, validated as a whole before anything is opened.

Each key states its default, its bounds and its meaning beside it, so that the check, the error sentences and
`hapticd run --print-config` cannot disagree. The default configuration runs the simulated plate.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import Field, dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

from .errors import ConfigError
from .toml_file import read_table, shown

SIMULATED = "sim"
MAX_PORT = 65535
MIN_DETERMINANT = 0.1  # of trackpad.matrix: scales of 0.5, the least allowed, have 0.25

# What the core and the simulation know by name, written down here too: a configuration is checked before they load.
PREDICTOR_NAMES = (
    "default",
    "hold",
    "linear",
    "alpha_beta",
    "alpha_beta_gamma",
    "double_exponential",
    "one_euro_linear",
    "least_squares",
    "kalman_cv",
    "kalman_ca",
    "kalman_singer",
    "kalman_jerk",
)
POLICY_NAMES = ("keep_zero", "keep_ratio", "least_squares", "priority", "paper")
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


def _key(
    default: Any, doc: str, *, low: float = -math.inf, high: float = math.inf, choices: tuple[str, ...] = ()
) -> Any:
    """A configuration key. `low` and `high` bound a number, or each number of a list."""
    return field(default=default, metadata={"doc": doc, "low": low, "high": high, "choices": choices})


@dataclass(frozen=True, slots=True)
class PlateConfig:
    """The glass plate and what was measured of it."""

    size_mm: tuple[float, ...] = _key((137.5, 137.5), "width (x) and depth (y)", low=10, high=1000)
    modes_file: str = _key("", "NPZ or CSV of the measured mode shapes; empty: the simulated plate's own cartography")
    neighbours_file: str = _key(
        "", "NPZ or CSV of the shapes of modes near the drive that only fingers drive; empty: none"
    )
    neighbours_detuning_hz: tuple[float, ...] = _key(
        (), "how far each of them lies above the drive", low=-1000, high=1000
    )
    neighbours_decay_1_s: tuple[float, ...] = _key((), "pi f / Q of each of them", low=1, high=10000)
    finger_decay_1_s: float = _key(
        100.0, "what one finger on a peak of a mode adds to its decay, for neighbours_file", low=0, high=2000
    )
    friction_curve: tuple[float, ...] = _key(
        (),
        "amplitude in um at equally spaced frictions 1 .. 0, rising from 0; empty: the built-in curve",
        low=0,
        high=100,
    )


@dataclass(frozen=True, slots=True)
class TrackpadConfig:
    """The position sensor under the plate, and where it lies."""

    source: str = _key(SIMULATED, "where reports come from", choices=(SIMULATED, "hid", "replay"))
    model: str = _key(
        "auto",
        "what the reports are; auto: whichever pad is connected",
        choices=("auto", "mt1", "mt2-usb", "mt2-bt", "usbc-usb", "usbc-bt"),
    )
    replay_file: str = _key("", 'recording to replay, for source = "replay"')
    offset_mm: tuple[float, ...] = _key((0.0, 0.0), "the pad's centre on the plate", low=-500, high=500)
    rotation_deg: float = _key(0.0, "the pad turned anticlockwise on the plate", low=-180, high=180)
    scale: tuple[float, ...] = _key((1.0, 1.0), "true mm per pad mm along the pad's x and y", low=0.5, high=2)
    matrix: tuple[float, ...] = _key(
        (), "rotation, scale and shear in one, rows of 2 x 2: xx, xy, yx, yy; empty: the two above", low=-2, high=2
    )
    latency_ms: float = _key(10.0, "from the finger's position to the report", low=0, high=50)
    silence_ms: float = _key(40.0, "fingers count as lifted when the pad is silent for so long", low=15, high=1000)


# By how much the plate lags each law on moving references, measured: `hapticd bench firmware`, table tracking.
LAW_DELAY_MS = {"pi": 1.0, "pi_ff": 0.0, "deadbeat": 0.0}


@dataclass(frozen=True, slots=True)
class DeviceConfig:
    """The board between the serial port and the amplifiers."""

    port: str = _key(SIMULATED, 'serial port, such as /dev/ttyACM0; "sim": the simulated board')
    baud: int = _key(921600, "serial speed", low=9600, high=5250000)
    link_ms: float = _key(5.0, "start value of the one-way delay; then it is measured", low=0, high=40)
    loop_delay_ms: float = _key(0.0, "by how much the plate follows later than its control law lets it", low=0, high=20)
    controller: str = _key("deadbeat", "control law on the board", choices=("pi", "pi_ff", "deadbeat"))
    calibration_file: str = _key(
        "", "TOML of the measured modes, as `hapticd firmware sweep --save` writes it; empty: the firmware's own"
    )

    @property
    def plate_delay_ms(self) -> float:
        """By how much the plate follows its reference late: the control law's own lag and `loop_delay_ms`."""
        return LAW_DELAY_MS[self.controller] + self.loop_delay_ms


@dataclass(frozen=True, slots=True)
class LimitsConfig:
    """What the amplifiers can give; held here and again by the firmware."""

    w_limit_um: tuple[float, ...] = _key((4.0, 4.0), "largest amplitude of each mode, peak to peak", low=0.01, high=20)


@dataclass(frozen=True, slots=True)
class PredictionConfig:
    """Where the fingers will be when the plate moves."""

    name: str = _key("default", "predictor; see `hapticd bench prediction`", choices=PREDICTOR_NAMES)
    period_ms: float = _key(11.25, "the pad's nominal report period", low=2, high=50)
    noise_mm: float = _key(0.053, "position noise that the predictor assumes, per axis", low=0.001, high=1)


@dataclass(frozen=True, slots=True)
class SolverConfig:
    """How modal amplitudes are found."""

    policy: str = _key("keep_zero", "what gives way at the limit", choices=POLICY_NAMES)
    effort: float = _key(0.0, "weight of |W|^2 against the slipping fingers' error", low=0, high=10)
    fade: float = _key(
        5.0,
        "mm2/um2: share of its target that a slipping finger must get for a slope of 1 um/mm under a still one, where "
        "a limit keeps it from more; else amplitude gives way; 0: it does not",
        low=0,
        high=100,
    )
    phase_rotation: bool = _key(
        True, "two slipping fingers or more change their signs by turning their phase, and never feel it"
    )
    contact_radius_mm: float = _key(
        0.0, "of a still finger's contact, over which its mean square is least; 0: a point", low=0, high=15
    )
    tolerance_um: float = _key(
        0.02, "error allowed between knots, and by which a standing reference may be off", low=1e-4, high=1
    )
    max_knots: int = _key(16, "knots in one reference frame", low=1, high=24)


@dataclass(frozen=True, slots=True)
class ClientConfig:
    """Where clients connect."""

    runtime_dir: str = _key("", "directory of the ipc endpoints; empty: the service's or the user's runtime directory")
    tcp: str = _key("", 'address for clients with a key, such as "192.168.7.1:7410"; takes 3 ports; empty: ipc only')
    keys_dir: str = _key("", "directory of the keys for tcp, as `hapticd keys` makes it")


@dataclass(frozen=True, slots=True)
class SimConfig:
    """The simulated rig, for trackpad and board on \"sim\"."""

    scenario: str = _key("strokes", "what the simulated fingers do", choices=SCENARIO_NAMES)
    seed: int = _key(1, "of fingers, noise and cartography", low=0, high=2**31 - 1)
    rig_dir: str = _key("", "directory of a rig that runs already; empty: the daemon starts one")


@dataclass(frozen=True, slots=True)
class RealtimeConfig:
    """What the service asks of the kernel; its unit file allows it."""

    fifo_priority: int = _key(0, "SCHED_FIFO priority of the loop; 0: ordinary scheduling", low=0, high=90)
    processor: int = _key(-1, "the one processor that the loop keeps to; -1: any", low=-1, high=1023)
    lock_memory: bool = _key(False, "keep all that was once touched in memory")


@dataclass(frozen=True, slots=True)
class RecordConfig:
    """What is written down; see hapticd/recording/README.md."""

    file: str = _key("", "recording of everything, from each start on; one that exists is kept; empty: none")
    max_mb: int = _key(512, "size at which a recording's file ends", low=1, high=1_000_000)
    max_files: int = _key(8, "files kept of one start: the next follows a full one, the oldest goes", low=1, high=999)


@dataclass(frozen=True, slots=True)
class LogConfig:
    """What is said."""

    level: str = _key("info", "least important line", choices=("debug", "info", "warning", "error"))


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


def load(path: Path) -> Config:
    """The configuration in the TOML file at `path`; keys not given keep their defaults. Raises ConfigError."""
    table = read_table(path, "check the path given to --config")
    return from_table(table, where=str(path), folder=path.parent)


def from_table(table: Mapping[str, Any], *, where: str, folder: Path | None) -> Config:
    """Validate a parsed table. `where` names it in errors; relative file names are taken from `folder`. Without one
    the files that it names are not looked for: they may be another machine's."""
    by_name = {section.name: section for section in fields(Config)}
    sections: dict[str, Any] = {}
    for name, value in table.items():
        if name not in by_name:
            raise ConfigError(f"{where}: unknown section [{name}]{_nearest(name, by_name)}.")
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: {name} is a section: write [{name}] and its keys below.")
        section_type = cast(type, by_name[name].default_factory)
        sections[name] = _section(section_type, value, f"{where}: {name}")
    config = Config(**sections)
    _check_together(config, where)
    return config if folder is None else _with_files(config, where, folder)


def simulated(config: Config) -> Config:
    """The same on the simulated plate: its own mode shapes, the firmware's own models of them, the pad centred."""
    return replace(
        config,
        plate=replace(config.plate, modes_file="", neighbours_file=""),
        trackpad=replace(
            config.trackpad,
            source=SIMULATED,
            model="auto",
            offset_mm=(0.0, 0.0),
            rotation_deg=0.0,
            scale=(1.0, 1.0),
            matrix=(),
        ),
        device=replace(config.device, port=SIMULATED, calibration_file=""),
    )


def render(config: Config) -> str:
    """The configuration as TOML with the meaning and bounds of each key: what is in force."""
    lines = []
    for section in fields(Config):
        value = getattr(config, section.name)
        lines.append(f"[{section.name}]  # {(value.__doc__ or '').rstrip('.')}")
        for entry in fields(value):
            bounds = _bounds_text(entry)
            comment = entry.metadata["doc"] + (f" ({bounds})" if bounds else "")
            lines.append(f"{entry.name} = {_toml(getattr(value, entry.name))}  # {comment}")
        lines.append("")
    return "\n".join(lines)


def _section(section_type: type, table: Mapping[str, Any], where: str) -> Any:
    by_name = {entry.name: entry for entry in fields(section_type)}
    values = {}
    for name, value in table.items():
        if name not in by_name:
            raise ConfigError(f"{where}.{name}: unknown key{_nearest(name, by_name)}.")
        values[name] = _checked(by_name[name], value, f"{where}.{name}")
    return section_type(**values)


def _checked(entry: Field[Any], value: Any, where: str) -> Any:
    default = entry.default
    if isinstance(default, tuple):
        if not isinstance(value, list) or not all(_is_number(item) for item in value):
            example = _toml(default or (0.0, 1.0))
            raise ConfigError(f"{where}: must be a list of numbers, such as {example}, not {shown(value)}.")
        return tuple(_bounded(entry, float(item), where) for item in value)
    if isinstance(default, str):
        if not isinstance(value, str):
            raise ConfigError(f"{where}: must be a text in quotes, not {shown(value)}.")
        if entry.metadata["choices"] and value not in entry.metadata["choices"]:
            raise ConfigError(f"{where}: {shown(value)} is none of {', '.join(entry.metadata['choices'])}.")
        return value
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise ConfigError(f"{where}: must be true or false, not {shown(value)}.")
        return value
    if isinstance(default, int) and not (isinstance(value, int) and not isinstance(value, bool)):
        raise ConfigError(f"{where}: must be a whole number, not {shown(value)}.")
    if not _is_number(value):
        raise ConfigError(f"{where}: must be a number, not {shown(value)}.")
    return _bounded(entry, value if isinstance(default, int) else float(value), where)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _bounded(entry: Field[Any], value: float, where: str) -> float:
    if entry.metadata["low"] <= value <= entry.metadata["high"]:  # NaN fails this, as it must
        return value
    raise ConfigError(f"{where}: {value:g} is out of bounds, it must be {_bounds_text(entry)}.")


def _bounds_text(entry: Field[Any]) -> str:
    if entry.metadata["choices"]:
        return " | ".join(entry.metadata["choices"])
    low, high = entry.metadata["low"], entry.metadata["high"]
    return "" if math.isinf(low) and math.isinf(high) else f"{low:g} .. {high:g}"


def _nearest(name: str, valid: Mapping[str, Any]) -> str:
    close = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    return f", did you mean {close[0]}?" if close else f", valid are {', '.join(valid)}"


def _check_together(config: Config, where: str) -> None:
    """What no single key can tell."""
    for name, value, length in (
        ("plate.size_mm", config.plate.size_mm, 2),
        ("trackpad.offset_mm", config.trackpad.offset_mm, 2),
        ("trackpad.scale", config.trackpad.scale, 2),
    ):
        if len(value) != length:
            raise ConfigError(f"{where}: {name}: needs {length} numbers, not {len(value)}.")
    _check_matrix(config.trackpad.matrix, where)
    if not 1 <= len(config.limits.w_limit_um) <= 8:
        raise ConfigError(f"{where}: limits.w_limit_um: needs one number for each mode (1 .. 8).")
    curve = config.plate.friction_curve
    if curve and (len(curve) < 2 or curve[0] != 0.0 or any(a >= b for a, b in pairwise(curve))):
        raise ConfigError(f"{where}: plate.friction_curve: needs two or more rising numbers, the first of them 0.")
    plate = config.plate
    if plate.neighbours_file and not len(plate.neighbours_detuning_hz) == len(plate.neighbours_decay_1_s) > 0:
        raise ConfigError(
            f"{where}: plate.neighbours_file: needs neighbours_detuning_hz and neighbours_decay_1_s too, a number for "
            "each of its modes."
        )
    if config.client.tcp:
        _check_tcp(config.client, where)
    if config.trackpad.source == SIMULATED and config.device.port != SIMULATED:
        raise ConfigError(
            f'{where}: trackpad.source: simulated fingers may not drive a real board: set it to "hid" or "replay", '
            f'or device.port to "{SIMULATED}".'
        )
    if config.device.port != SIMULATED and not config.plate.modes_file:
        raise ConfigError(f"{where}: plate.modes_file: a real plate needs its measured mode shapes (NPZ or CSV).")


def _check_matrix(matrix: tuple[float, ...], where: str) -> None:
    """Empty, or a map of the pad onto the plate that loses no direction."""
    if len(matrix) not in (0, 4):
        raise ConfigError(f"{where}: trackpad.matrix: needs 4 numbers, xx, xy, yx, yy, not {len(matrix)}.")
    if matrix and not abs(matrix[0] * matrix[3] - matrix[1] * matrix[2]) >= MIN_DETERMINANT:
        raise ConfigError(f"{where}: trackpad.matrix: lays the pad on a line: measure it again.")


def _check_tcp(client: ClientConfig, where: str) -> None:
    """An address and three ports to bind, and never without keys."""
    host, _, port = client.tcp.rpartition(":")
    if not (host and port.isascii() and port.isdigit() and 1 <= int(port) <= MAX_PORT - 2):
        raise ConfigError(
            f"{where}: client.tcp: must be an address and the first of three ports, such as "
            f'"192.168.7.1:7410", not {client.tcp!r}.'
        )
    if not client.keys_dir:
        raise ConfigError(
            f"{where}: client.tcp: nobody is served over TCP without keys: make some with `hapticd keys make`, and "
            "name their directory in client.keys_dir."
        )


def _with_files(config: Config, where: str, folder: Path) -> Config:
    """The same with file names made absolute, each file seen to be there."""
    for section, key in _file_keys():
        name = getattr(getattr(config, section), key)
        if not name:
            continue
        path = (folder / name).resolve()
        if not _is_file(path):
            raise ConfigError(f"{where}: {section}.{key}: there is no file {path}.")
        config = replace(config, **{section: replace(getattr(config, section), **{key: str(path)})})
    if config.client.keys_dir:
        config = replace(
            config, client=replace(config.client, keys_dir=str((folder / config.client.keys_dir).resolve()))
        )
    if config.record.file:
        config = replace(config, record=replace(config.record, file=str((folder / config.record.file).resolve())))
    if config.trackpad.source == "replay" and not config.trackpad.replay_file:
        raise ConfigError(f'{where}: trackpad.replay_file: source = "replay" needs a recording.')
    return config


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # no file system takes such a name
        return False


def _file_keys() -> Iterator[tuple[str, str]]:
    for section in fields(Config):
        for entry in fields(cast(type, section.default_factory)):
            if entry.name.endswith("_file"):
                yield section.name, entry.name


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, tuple):
        return "[" + ", ".join(_toml(item) for item in value) + "]"
    return repr(value)

"""What other settings would have made of a recording: the same reports and wishes, the same passes, another core.

The plate is not there, so all are judged by an ideal loop: the plate does at each instant what the reference says. The
passes come when they came, and aim as far ahead as the recorded ones, for the board's answers belong to what was sent.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ...config import loader as configuration
from ...config.sections import Config
from ...core.board.supervisor import State
from ...daemon.machine import Machine
from ...errors import ConfigError, RecordingError, RequestError
from ...files.recording.reader import Recording
from ...files.recording.records import Record
from ...files.toml_file import parse
from ...sim.score import Score, score
from ...values import ClientTargets
from ...wire import client as client_wire
from .replay import machine_of
from .tracks import Tracks, tracks

Polyline = tuple[int, tuple[tuple[int, tuple[complex, ...]], ...]]  # t_apply_ns and knots, each dt_ns and amplitudes


# Keys of [plate] that say which plate it is.
_OF_THE_PLATE = (
    "modes_file",
    "parasitic_modes_file",
    "parasitic_detuning_hz",
    "parasitic_decay_1_s",
    "finger_decay_1_s",
)


class Judged(NamedTuple):
    """One choice of settings, and what came of it."""

    name: str
    score: Score


def changed(config: Config, changes: Sequence[str]) -> Config:
    """The configuration with each of `changes`, such as "prediction.noise_mm=0.1". Raises ConfigError."""
    table = parse(configuration.render(config), "--set")
    for change in changes:
        name, equals, value = change.partition("=")
        section, dot, key = name.strip().partition(".")
        if not (equals and dot and key):
            raise ConfigError(f"--set {change}: write SECTION.KEY=VALUE, such as prediction.noise_mm=0.1.")
        if section == "plate" and key.strip() in _OF_THE_PLATE:
            raise ConfigError(f"--set {change}: the plate is the recorded one; change how it is driven.")
        table.setdefault(section, {})[key] = _value(value.strip(), change)
    return configuration.from_table(table, where="--set", folder=None)


def _value(text: str, change: str) -> object:
    """As TOML, or else as a text without its quotes."""
    try:
        return parse(f"value = {text}", change)["value"]
    except ConfigError:
        return text


def compare(recording: Recording, changes: Sequence[str]) -> tuple[Tracks, list[Judged]]:
    """The recorded references, those of each change alone, and those of all, judged on the same fingers.

    Raises RecordingError where nothing can be judged, ConfigError for a change that cannot be.
    """
    base = recording.header.config
    choices = [(change, changed(base, [change])) for change in changes]
    if len(changes) > 1:
        choices.append(("all of these", changed(base, changes)))
    records = list(recording.records())
    fingers = tracks(records)
    judged = [Judged("as recorded", _judge(recording, fingers, _recorded(records)))]
    for name, settings in choices:
        judged.append(Judged(name, _judge(recording, fingers, rehearse(recording, records, settings))))
    return fingers, judged


def rehearse(recording: Recording, records: Iterable[Record], config: Config) -> list[Polyline]:
    """The references that a core with these settings makes of the recording. Raises RecordingError."""
    machine = machine_of(recording, config, lambda _: True)
    header = recording.header
    machine.trackpad_link(True, "recorded", header.t_start_ns, model=header.trackpad_model)
    lag_ns = round(header.config.device.plate_delay_ms * 1e6)
    made: list[Polyline] = []
    ids = _Ids()
    try:
        for record in records:
            if record.kind == "pass":
                ids.learn(record, machine)
                polyline = _pass(machine, record, lag_ns)
                if polyline is not None:
                    made.append(polyline)
            else:
                _tell(machine, record, ids)
    except (ArithmeticError, ValueError, LookupError) as error:
        raise RecordingError(f"These settings cannot be tried on this recording: {error}.") from error
    return made


class _Ids:
    """A core that joins late counts its fingers from 1: `ahead` is by how much the recorded ids are larger."""

    def __init__(self) -> None:
        self.ahead = 0

    def learn(self, record: Record, machine: Machine) -> None:
        recorded, own = record.fields[5], machine.pipeline.fingers
        if recorded and len(recorded) == len(own):
            self.ahead = recorded[0][0] - own[0].finger_id

    def own(self, message: ClientTargets) -> ClientTargets:
        return replace(message, targets={self.own_key(key): target for key, target in message.targets.items()})

    def own_key(self, key: int | str) -> int | str:
        return key - self.ahead if isinstance(key, int) else key


def _tell(machine: Machine, record: Record, ids: _Ids) -> None:
    """What changes fingers or wishes; the rest is the board's."""
    t_ns, *values = record.fields
    if record.kind == "reports":
        for report in values[0]:
            for frame in machine.trackpad.decode(report[1], report[0]):
                machine.pipeline.touch(frame, report[0])
    elif record.kind == "trackpad_link":
        is_up, reason, model = values
        machine.trackpad_link(is_up, reason, t_ns, model=model)
    elif record.kind == "timer":
        machine.pipeline.release(machine.scene.expire(t_ns))
        if machine.pipeline.sensor_is_silent(t_ns):
            machine.pipeline.sensor_lost()
    elif record.kind in ("targets", "request"):
        _want(machine, record, ids)


def _want(machine: Machine, record: Record, ids: _Ids) -> None:
    t_ns, payload, _ = record.fields
    try:
        if record.kind == "targets":
            machine.scene.apply(ids.own(client_wire.decode_targets(payload)), t_ns)
            return
        body = client_wire.decode_request(payload).body
    except RequestError:
        return  # it was refused then, too
    if isinstance(body, ClientTargets):
        machine.scene.apply(ids.own(body), t_ns)
    elif isinstance(body, client_wire.Release):
        if body.finger is None:
            machine.scene.release_client(body.client)
        else:
            machine.scene.release(body.client, ids.own_key(body.finger))


def _pass(machine: Machine, record: Record, lag_ns: int) -> Polyline | None:
    t_ns, age_ns, horizon_ns, state, *_ = record.fields
    ahead_ns = max(horizon_ns - age_ns - lag_ns, 0)
    pipeline = machine.pipeline
    tick = pipeline.drive(t_ns, ahead_ns) if state == State.ACTIVE.name else pipeline.rest(t_ns, ahead_ns)
    return None if tick.drive is None else (tick.drive.t_apply_ns, tick.drive.knots)


def _recorded(records: Iterable[Record]) -> list[Polyline]:
    made: list[Polyline] = []
    for record in records:
        if record.kind == "pass" and record.fields[7] is not None:
            knots = [(dt_ns, tuple(complex(*w) for w in modal_um)) for dt_ns, modal_um in record.fields[9]]
            made.append((record.fields[7], tuple(knots)))
    return made


def _judge(recording: Recording, fingers: Tracks, made: Sequence[Polyline]) -> Score:
    modal_um = in_force_um(fingers.t_ns, made, recording.header.modes.M)
    felt_um = fingers.felt_um(recording.header.modes, modal_um)
    t_s = (fingers.t_ns - fingers.t_ns[0]) * 1e-9
    return score(t_s, fingers.target_um, felt_um, modal_um, np.zeros(0, dtype=bool))


def in_force_um(t_ns: npt.NDArray[np.int64], made: Sequence[Polyline], modes: int) -> npt.NDArray[np.complex128]:
    """What the references say at each instant (T,M): the one that began last, 0 before the first."""
    modal_um = np.zeros((len(t_ns), modes), dtype=np.complex128)
    ordered = sorted((polyline for polyline in made if polyline[1]), key=lambda polyline: polyline[0])
    bounds = [*np.searchsorted(t_ns, [t_apply_ns for t_apply_ns, _ in ordered]).tolist(), len(t_ns)]
    for index, (t_apply_ns, knots) in enumerate(ordered):
        part = slice(bounds[index], bounds[index + 1])
        since_ns = t_ns[part] - t_apply_ns
        dt_ns = [dt for dt, _ in knots]
        for mode in range(min(modes, *(len(row) for _, row in knots))):
            row = np.array([complex(amplitudes[mode]) for _, amplitudes in knots])
            modal_um[part, mode] = np.interp(since_ns, dt_ns, row.real) + 1j * np.interp(since_ns, dt_ns, row.imag)
    return modal_um


def table(fingers: Tracks, judged: Sequence[Judged]) -> str:
    """For a person."""
    width = max(len(name) for name, _ in judged)
    rows = [f"{'':<{width}}{'leak um':>10}{'slip error um':>15}{'slip':>8}"]
    for name, one in judged:
        cells = (one.leak_um, one.slip_error_um, one.slip_frac)
        rows.append(f"{name:<{width}}" + "".join(map(_cell, cells, (10, 15, 8))))
    if all(math.isnan(one.leak_um) and math.isnan(one.slip_frac) for _, one in judged):
        rows.append("nobody asked for anything while fingers touched: there is nothing to judge")
    where = "true positions" if fingers.is_true else "positions that the pad saw (there is no truth in it)"
    rows.append(f"judged at the fingers' {where}, by an ideal loop: the plate is not there")
    return "\n".join(rows)


def _cell(value: float, width: int) -> str:
    return f"{format(value, '.4f') if math.isfinite(value) else '-':>{width}}"

"""What other settings would have made of a recording: the same inputs, the same passes, another core.

The plate is not there, so all are judged by an ideal loop: the plate does at each instant what the reference says. The
board's answers belong to what was sent, so each pass takes from the recorded one how far ahead it aims and whether the
board may be driven.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import msgpack
import numpy as np
import numpy.typing as npt

from ...config import loader as configuration
from ...config.sections import Config
from ...core.board.supervisor import State
from ...core.plate.mode_shapes import ModeShapes
from ...daemon.machine import Machine
from ...daemon.settings import friction_curve
from ...errors import ConfigError
from ...files.recording.kinds import Fields, Record, phasors
from ...files.recording.mcap_reader import Recording
from ...formats.toml_file import parse
from ...sim.score import Score, score, with_contacts
from ...values import Aim, FloatArray
from .replay import feed, steps
from .tracks import Tracks, tracks

Polyline = tuple[int, tuple[tuple[int, tuple[complex, ...]], ...]]  # t_apply_ns and knots, each dt_ns and amplitudes


# Keys of [plate] that describe the plate itself.
_OF_THE_PLATE = (
    "modes_file",
    "parasitic_modes_file",
    "parasitic_detuning_hz",
    "parasitic_decay_1_s",
)


class _Judged(NamedTuple):
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


def compare(recording: Recording, changes: Sequence[str]) -> tuple[Tracks, list[_Judged]]:
    """The recorded references, those of each change alone, and those of all, judged on the same fingers.

    Raises RecordingError where nothing can be judged, ConfigError for a change that cannot be.
    """
    base = recording.header.config
    choices = [(change, changed(base, [change])) for change in changes]
    if len(changes) > 1:
        choices.append(("all of these", changed(base, changes)))
    records = list(recording.records())
    fingers = tracks(records)
    judged = [_Judged("as recorded", _judge(recording, fingers, _recorded(records)))]
    for name, settings in choices:
        judged.append(_Judged(name, _judge(recording, fingers, rehearse(recording, records, settings))))
    return fingers, judged


def rehearse(recording: Recording, records: Iterable[Record], config: Config) -> list[Polyline]:
    """The references that a core with these settings makes of the recording. Raises RecordingError."""
    header = recording.header
    machine = _Rehearsal(
        config,
        header.modes,
        write_board=lambda _: True,
        instance=header.instance,
        parasitic_modes=header.parasitic_modes,
    )
    made: list[Polyline] = []

    def keep(kind: str, _: int, *values: Any) -> None:
        if kind == "pass" and values[0].drive is not None:
            drive = values[0].drive
            made.append((drive.t_apply_ns, tuple((knot.dt_ns, knot.modal_um) for knot in drive.knots)))

    machine.trackpad_link(True, "recorded", header.t_start_ns, pad=header.pad)
    machine.observer = keep
    lag_ns = round(header.config.device.plate_delay_ms * 1e6)
    for step in steps(records):
        if step.input.kind in _REHEARSED:
            recorded = next((record.fields for record in step.effects if record.kind == "pass"), None)
            if recorded is not None:
                machine.aim_as(recorded, lag_ns)
            feed(machine, _renumbered(step.input, machine.ids_ahead))
            if recorded is not None:
                machine.compare_ids(recorded["fingers"])
    return made


# The rest concerns the board and the daemon's end.
_REHEARSED = ("reports", "timer", "trackpad_link", "targets", "request")


class _Rehearsal(Machine):
    """A machine without a board, whose passes aim as far ahead and drive when the recorded ones did.

    A machine that joins late counts its fingers from 1: `ids_ahead` is by how much the recorded ids are larger.
    """

    ids_ahead = 0
    _aim = Aim(0, may_drive=False)

    def aim_as(self, recorded: Fields, lag_ns: int) -> None:
        """Take the recorded pass's aim, with the plate's lag taken off."""
        ahead_ns = max(recorded["horizon_ns"] - recorded["age_ns"] - lag_ns, 0)
        self._aim = Aim(ahead_ns, may_drive=recorded["state"] == State.ACTIVE.name)

    def compare_ids(self, recorded: Sequence[Fields]) -> None:
        """Learn from the fingers that a recorded pass had."""
        own = self.pipeline.fingers
        if recorded and len(recorded) == len(own):
            self.ids_ahead = recorded[0]["finger_id"] - own[0].finger_id

    def aim(self, t_now_ns: int) -> Aim:  # noqa: ARG002
        return self._aim


def _renumbered(record: Record, ids_ahead: int) -> Record:
    """A client's message with the finger ids of a machine that joined late."""
    if not ids_ahead or "payload" not in record.fields:
        return record

    def own(value: Any) -> Any:
        if isinstance(value, list):
            return [own(item) for item in value]
        if not isinstance(value, dict):
            return value
        return {
            name: item - ids_ahead if name == "finger" and type(item) is int else own(item)
            for name, item in value.items()
        }

    try:
        payload = msgpack.packb(own(msgpack.unpackb(record.fields["payload"])))
    except (ValueError, TypeError, OverflowError, RecursionError, msgpack.UnpackException):
        return record  # the machine refuses it, as the recorded one did
    return record._replace(fields=record.fields | {"payload": payload})


def _recorded(records: Iterable[Record]) -> list[Polyline]:
    made: list[Polyline] = []
    for record in records:
        if record.kind == "pass" and "t_apply_ns" in record.fields:
            knots = [(knot["dt_ns"], phasors(knot["modal_um"])) for knot in record.fields.get("knots", [])]
            made.append((record.fields["t_apply_ns"], tuple(knots)))
    return made


def _judge(recording: Recording, fingers: Tracks, made: Sequence[Polyline]) -> Score:
    modal_um = in_force_um(fingers.t_ns, made, recording.header.modes.M)
    felt_um = fingers.felt_um(recording.header.modes, modal_um)
    t_s = (fingers.t_ns - fingers.t_ns[0]) * 1e-9
    judged = score(t_s, fingers.target_um, felt_um, modal_um, np.zeros(0, dtype=bool))
    return with_contacts(
        judged,
        *(t_s, fingers.position_mm, fingers.target_um, modal_um, _shapes(recording.header.modes)),
        friction=friction_curve(recording.header.config).frictions,
        fingertips=fingers.contacts,
    )


def _shapes(modes: ModeShapes) -> Callable[[FloatArray], FloatArray]:
    """Return the mode shapes (..., M) at places (..., 2) of any shape; NaN gives zeros."""

    def shapes(places_mm: FloatArray) -> FloatArray:
        flat_mm = np.nan_to_num(places_mm).reshape(-1, 2)
        return modes.evaluate(flat_mm).reshape(*places_mm.shape[:-1], modes.M)

    return shapes


def in_force_um(t_ns: npt.NDArray[np.int64], made: Sequence[Polyline], modes: int) -> npt.NDArray[np.complex128]:
    """The references at each instant (T,M): the one that began last, 0 before the first."""
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


def table(fingers: Tracks, judged: Sequence[_Judged]) -> str:
    """For a person."""
    width = max(len(name) for name, _ in judged)
    widths = (8, 10, 15, 8, 18, 10, 8)
    heads = ("felt", "leak um", "slip error um", "slip", "friction: sticky", "slippery", "weber")
    rows = [" " * width + "".join(f"{head:>{wide}}" for head, wide in zip(heads, widths, strict=True))]
    for name, one in judged:
        errors = (one.leak_um, one.slip_error_um, one.slip_frac)
        perceived = (one.still_friction_change, one.slip_friction_change, one.weber_frac)
        rows.append(f"{name:<{width}}" + "".join(map(_cell, (one.felt_frac, *errors, *perceived), widths)))
    if all(math.isnan(one.leak_um) and math.isnan(one.slip_frac) for _, one in judged):
        rows.append("no finger had a target while it touched: there is nothing to judge")
    where = "true positions" if fingers.is_true else "positions by the pad (there is no ground truth in it)"
    rows.append(f"judged at the fingers' {where}, by an ideal loop: the plate is not there")
    return "\n".join(rows)


def _cell(value: float, width: int) -> str:
    return f"{format(value, '.4f') if math.isfinite(value) else '-':>{width}}"

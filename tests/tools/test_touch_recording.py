"""What a recording shows of the plate: a tick at the voltage limit counts, by what the ticks around it read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hapticd.config.sections import Config, RecordConfig
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.recorder import header_of
from hapticd.files.recording.header import Header
from hapticd.files.recording.kinds import record_of
from hapticd.sim import lockstep
from hapticd.sim.lockstep import T_START_NS
from hapticd.sim.settings import Settings
from hapticd.tools.touch_recording import COLLECTED, Collected, touched


def collected() -> tuple[Collected, Header]:
    """Two seconds of strokes."""
    config = Config(record=RecordConfig(telemetry_hz=500))
    made, headers = Collected(), list[Header]()

    def observer(machine: Machine, _: ModeShapes) -> Observer:
        headers.append(header_of(machine, t_ns=T_START_NS, utc="", is_whole=True))

        def put(kind: str, t_ns: int, *values: Any) -> None:
            if kind in COLLECTED:
                made.take(record_of(kind, 0, t_ns, values))

        return put

    lockstep.run("strokes", settings=Settings(config=config), seed=1, seconds=2.0, observer=observer)
    return made, headers[0]


def test_ticks_at_the_voltage_limit_have_the_slope_of_those_before_and_after() -> None:
    seen, header = collected()
    free = touched(seen, header, "the touching").ticks
    limited = range(100, len(seen.samples) - 1, 10)
    for index in limited:
        seen.samples[index] = replace(seen.samples[index], saturated=True)
    ticks = touched(seen, header, "the touching").ticks
    assert len(ticks.t_s) == pytest.approx(len(free.t_s), abs=3)
    voltages_v = [mode.voltage_v for index in limited for mode in seen.samples[index].modes]
    at = np.flatnonzero(np.isin(free.voltage_v, voltages_v).all(axis=1))
    assert len(at) > 30
    where = np.searchsorted(ticks.t_s, free.t_s[at] - 1e-6)
    moved_um_s = np.abs(ticks.slope_um_s[where] - free.slope_um_s[at])
    assert (moved_um_s > 0.0).mean() > 0.9  # by what was measured, no longer by the reference
    assert np.median(moved_um_s) < 0.1 * np.median(np.abs(free.slope_um_s[at]))

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

import pytest

from hapticd.sim.fingers.paths import Rest
from hapticd.sim.fingers.sensor import SensorModel
from hapticd.tools.calibrate import prediction
from hapticd.values import RawReport
from hapticd.wire.trackpad import DEFAULT_PAD, Pad

MOUSE_REPORT = bytes((0x02, *bytes(7)))


class ReconnectedPad:
    """A pad that reports as a mouse, is unplugged, and then reports a finger."""

    enabled = 0
    is_closed = False

    def start(
        self,
        _: asyncio.AbstractEventLoop,
        on_reports: Callable[[Sequence[RawReport]], None],
        on_link: Callable[[Pad | None, str], None],
    ) -> None:
        on_link(DEFAULT_PAD, "plugged in")
        on_reports([RawReport(0, MOUSE_REPORT)])
        on_link(None, "unplugged")
        on_link(DEFAULT_PAD, "plugged in")
        reports = SensorModel(seed=1).reports([Rest((10.0, 5.0))], 0.2)
        on_reports([RawReport(round(report.t_arrive_s * 1e9), report.data) for report in reports])

    @property
    def counters(self) -> dict[str, int | str]:
        return {}

    def request_enable(self) -> None:
        self.enabled += 1

    async def close(self) -> None:
        self.is_closed = True


def test_a_pad_is_enabled_read_after_a_reconnect_and_closed(capsys: pytest.CaptureFixture[str]) -> None:
    pad = ReconnectedPad()
    (trace,) = asyncio.run(prediction._touched(pad, 0.01))
    assert pad.enabled == 1
    assert pad.is_closed
    assert trace.xy_mm.mean(axis=0) == pytest.approx((10.0, 5.0), abs=0.2)
    assert capsys.readouterr().out.count("stroke the pad for 0.01 s") == 2

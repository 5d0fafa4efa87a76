"""A rehearsed study: its simulated plate."""

from __future__ import annotations

import pytest

from hapticd.config.sections import SimConfig
from hapticd.tools.study import program


def test_a_rehearsal_is_on_the_plate_and_the_wiring_that_were_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    tables: list[str] = []
    monkeypatch.setattr(program, "DaemonProcess", lambda sim, *_, **__: tables.append(sim))
    program.rehearsal(plate=SimConfig(plate="fingertip", modes=5, wiring="inverted"))
    assert tables[0].splitlines()[1:] == ['plate = "fingertip"', "modes = 5", 'wiring = "inverted"']

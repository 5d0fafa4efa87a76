"""Sizes of contacts that touches show: how much is adopted, and that a machine then does as one configured so."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from hapticd.config.sections import Config
from hapticd.core.plate.mode_shapes import ModeShapes
from hapticd.daemon.contact_sizes import AdoptedSizes, SizesAdoption
from hapticd.daemon.machine import Machine
from hapticd.daemon.observer import Observer
from hapticd.daemon.recorder import header_of
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.files.recording.mcap_writer import DirectRecording
from hapticd.sim.fingers.fingertip import Fingertip
from hapticd.sim.lockstep import T_START_NS, run
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings, scheme_config
from hapticd.tools.record.replay import replay

LAW = AdoptedSizes(6.0, 1.2, 0.4)
FINGERTIP = PlateSettings.of("fingertip")
ON_FOUR_MODES = scheme_config(Settings(plate=FINGERTIP))


def configured(sizes: AdoptedSizes) -> Config:
    solver = replace(ON_FOUR_MODES.solver, contact_radius_mm=sizes.radius_mm)
    law = {"ellipse_scale": sizes.ellipse_scale, "ellipse_offset_mm": sizes.ellipse_offset_mm}
    return replace(ON_FOUR_MODES, solver=solver, trackpad=replace(ON_FOUR_MODES.trackpad, **law))


def test_half_of_a_law_lies_between_the_configured_disc_and_the_ellipse() -> None:
    half = LAW.part(0.5, AdoptedSizes(5.0))
    for reported_mm in (7.0, 9.0, 12.0):
        axis_mm = half.ellipse_scale * reported_mm + half.ellipse_offset_mm
        assert axis_mm == pytest.approx((10.0 + 1.2 * reported_mm + 0.4) / 2.0)
    assert LAW.part(1.0, AdoptedSizes(5.0)) == LAW
    assert AdoptedSizes(6.0).part(0.5, AdoptedSizes(5.0, 1.1, 0.2)) == AdoptedSizes(5.5, 1.1, 0.2)


@pytest.mark.parametrize(
    "sizes",
    [AdoptedSizes(2.9), AdoptedSizes(float("nan")), AdoptedSizes(6.0, -0.1), AdoptedSizes(6.0, 1.0, float("inf"))],
)
def test_sizes_that_no_finger_has_are_not_allowed(sizes: AdoptedSizes) -> None:
    adoption = SizesAdoption(ON_FOUR_MODES)
    assert adoption.allows(LAW)
    assert not adoption.allows(sizes)
    assert not SizesAdoption(Config()).allows(LAW)  # points


def test_half_is_adopted_first_all_once_it_is_found_again_and_all_is_taken_back() -> None:
    adoption = SizesAdoption(configured(AdoptedSizes(5.0, 1.0, 0.0)))
    adoption.take_back()
    assert not adoption.is_due
    adoption.take(LAW)
    assert (adoption.is_due, adoption.now) == (True, AdoptedSizes(5.5, 1.1, 0.2))
    adoption.take(LAW._replace(radius_mm=7.0))  # another: again half
    assert adoption.now == AdoptedSizes(6.0, 1.1, 0.2)
    adoption.take(LAW)
    adoption.take(LAW)
    assert adoption.now == LAW
    adoption.take_back()
    assert adoption.now == AdoptedSizes(5.0, 1.0, 0.0)
    adoption.is_due = False
    assert adoption.report() is None


def lines(config: Config, prepare: Callable[[Machine], Observer | None]) -> list[bytes]:
    """Every line to the board in a short run on the fingertip plate, with ellipses that the pad reports."""
    written: list[bytes] = []

    def observer(machine: Machine, _: ModeShapes) -> Observer:
        also = prepare(machine)

        def put(kind: str, t_ns: int, *values: Any) -> None:
            if also is not None:
                also(kind, t_ns, *values)
            if kind == "written":
                written.append(values[0])

        machine.observer = put
        return put

    settings = Settings(plate=FINGERTIP, fingertip=Fingertip(6.0, 6.0), config=config)
    run("strokes", settings=settings, seed=1, seconds=0.6, observer=observer)
    return written


@pytest.mark.parametrize("sizes", [LAW, AdoptedSizes(6.5)])
def test_a_machine_that_adopts_sizes_drives_as_one_that_is_configured_so_and_it_replays(
    sizes: AdoptedSizes, tmp_path: Path
) -> None:
    before = configured(AdoptedSizes(5.0, 1.0, 0.0)) if sizes.ellipse_scale == 0.0 else configured(AdoptedSizes(5.0))
    path, recordings = tmp_path / "adopted.mcap", list[DirectRecording]()

    def adopting(machine: Machine) -> Observer:
        header = header_of(machine, t_ns=T_START_NS, utc="1970-01-01T00:00:00Z", is_whole=True)
        recordings.append(DirectRecording(path, header))
        machine.observer = recordings[0].put
        machine.adopt_contacts(*sizes, T_START_NS)
        assert machine.describe_plate().contact_radius_mm == sizes.radius_mm
        return recordings[0].put

    adopted = lines(before, adopting)
    recordings[0].close(T_START_NS + 600_000_000, "the test ended")
    assert adopted == lines(configured(sizes), lambda _: None)
    assert adopted != lines(before, lambda _: None)
    outcome = replay(open_recording(path))
    assert outcome.is_identical
    assert outcome.references > 10


@pytest.mark.parametrize("sizes", [(0.0, 0.0, 0.0), (float("nan"), 1.0, 0.0), (5.0, float("inf"), 0.0)])
def test_what_is_no_size_is_refused_by_the_machine(sizes: tuple[float, float, float]) -> None:
    made: list[Machine] = []
    lines(ON_FOUR_MODES, lambda machine: made.append(machine))
    with pytest.raises(ValueError, match="radius above 0 mm"):
        made[0].adopt_contacts(*sizes, T_START_NS)

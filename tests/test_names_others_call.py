"""Names that programs outside the project call: they stay, with their parameters."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest

import hapticd.sim
from hapticd.bench import baselines
from hapticd.core import prediction, solver
from hapticd.core.plate import ModeShapes
from hapticd.design import free_plate_modes
from hapticd.values import Contact, TouchFrame
from hapticd.wire import device, trackpad
from hapticd_client import Client
from hapticd_contract.contents import CONTENTS


@pytest.mark.parametrize(
    ("function", "names"),
    [
        (ModeShapes.from_grid, "x_mm y_mm shapes"),
        (ModeShapes.load, "path"),
        (ModeShapes.save, "path"),
        (ModeShapes.evaluate, "points_mm"),
        (ModeShapes.gradient, "points_mm"),
        (ModeShapes.inside, "points_mm"),
        (solver.solve, "phi target_um limit_um previous_um gram"),
        (solver.solve_batch, "phi target_um limit_um previous_um"),
        (baselines.solve, "phi target_um limit_um policy previous_um"),
        (prediction.make_predictor, "name settings"),
        (trackpad.Decoder.decode, "report t_host_ns"),
        (device.Decoder.feed, "data"),
        (free_plate_modes, "size_mm thickness_mm young_gpa poisson density_kg_m3 band_hz"),
        (hapticd.sim.run, "scenario settings seed seconds"),
        (TouchFrame, "t_ns contacts button"),
        (Contact, "contact_id x_mm y_mm major_mm minor_mm angle_rad pressure_frac touching state raw_x raw_y"),
        (Client, "endpoint"),
        (Client.set, "finger friction amplitude_um grating map ttl_s"),
        (Client.virtual, "name position_mm path"),
    ],
)
def test_a_function_takes_these_parameters(function: Callable[..., Any], names: str) -> None:
    parameters = set(inspect.signature(function).parameters)
    if "content" in parameters:  # by its name in the contract
        parameters |= {*CONTENTS}
    assert set(names.split()) <= parameters


def test_a_run_has_its_arrays_by_name_and_takes_settings_by_name() -> None:
    run = hapticd.sim.run("strokes", settings={"speed_mm_s": 50.0}, seed=1, seconds=0.2)
    assert run.settings.speed_mm_s == 50.0
    names = ("t_s", "finger_true_mm", "finger_predicted_mm", "target_um", "reference_um", "modal_um", "truth_um")
    assert {len(getattr(run, name)) for name in (*names, "limited")} == {len(run.t_s)}
    with pytest.raises(ValueError, match=r"^there is no setting 'speed': choose from [^\n]*\.$"):
        hapticd.sim.run("strokes", settings={"speed": 50.0})

"""Messages between page and server."""

from __future__ import annotations

import json
import math
from pathlib import Path

import msgpack
import numpy as np
import pytest

from hapticd.errors import RequestError
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.rig.files import write_measured
from hapticd.tools.view import messages
from hapticd.tools.view.client import GRID, _name, modes_of, picture_grid
from hapticd.tools.view.messages import Hold, RecordPage
from hapticd.tools.view.rig import Truth, decode_truth
from hapticd_client import FingerState, PlateEvent, PlateState
from hapticd_contract.simulated import SimulatedTouch

STATE = PlateState(
    instance=7,
    seq=1,
    t_ns=2_500_000_000,
    state="ACTIVE",
    fingers=(
        FingerState(3, 1.0, 2.0, 1.5, 2.5, 1.0, 0.98, False, "study"),
        FingerState("post", math.nan, math.nan, None, None, None, None, True),
    ),
    modal_um=(1.5, -2.0),
    limited=True,
    age_ms=10.0,
    horizon_ms=math.nan,
    modal_q_um=(0.25, 0.0),
    measured_d_q_um=((1.4, 0.2), (math.nan, 0.0)),
)

LONG = "9" * 3000  # no float holds it; Python reads no whole number of twice as many digits


@pytest.mark.parametrize(
    ("text", "decoded"),
    [
        ('{"op": "fingers", "fingers": {"mouse": [1, -2.5]}}', Hold({"mouse": SimulatedTouch(1.0, -2.5)})),
        ('{"op": "fingers", "fingers": {"mouse": [1, -2.5, 0.6]}}', Hold({"mouse": SimulatedTouch(1.0, -2.5, 0.6)})),
        ('{"op": "fingers", "fingers": {}}', Hold({})),
        ('{"op": "record", "is_on": true}', RecordPage(True)),
    ],
)
def test_a_page_s_request_is_decoded(text: str, decoded: object) -> None:
    assert messages.decode(text) == decoded


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "[" * 5000,
        '{"op": "explode"}',
        '{"op": "record"}',
        '{"op": "record", "is_on": true, "more": 1}',
        '{"op": "fingers", "fingers": {"a": [1]}}',
        '{"op": "fingers", "fingers": {"a": [1, Infinity]}}',
        '{"op": "fingers", "fingers": [1, 2]}',
        f'{{"op": "fingers", "fingers": {{"a": [1, {LONG}]}}}}',
        f'{{"op": {LONG}}}',
        f'{{"op": "fingers", "fingers": {{"a": [1, {2 * LONG}]}}}}',
    ],
)
def test_an_invalid_request_is_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(RequestError, match=r"^.{1,120}\.$"):
        messages.decode(text)


def test_a_frame_is_complete_and_valid_json() -> None:
    truth = Truth(0, ((1.1, 2.1),), ((1.45, 0.2), (-2.0, 0.0)), ((0.0, 0.99),))
    frame = json.loads(messages.frame(STATE, truth), parse_constant=pytest.fail)
    real, virtual = frame["fingers"]
    assert frame["t_s"] == 2.5
    assert (real["id"], real["seen_mm"], real["predicted_mm"], real["owner"]) == (3, [1.0, 2.0], [1.5, 2.5], "study")
    assert (virtual["seen_mm"], virtual["predicted_mm"], virtual["target_um"]) == ([None, None], None, None)
    assert frame["modal_um"] == [[1.5, 0.25], [-2.0, 0.0]]
    assert frame["measured_um"] == [[1.4, 0.2], [None, 0.0]]
    assert frame["truth"] == {
        "t_ns": 0,
        "fingers_mm": [[1.1, 2.1]],
        "modal_um": [[1.45, 0.2], [-2.0, 0.0]],
        "truth_um": [[0.0, 0.99]],
    }
    assert json.loads(messages.frame(STATE, None))["truth"] is None


def test_a_frame_has_the_events_since_the_one_before() -> None:
    event = PlateEvent(41, "begun", 2_400_000_000, None, 3, -20.5, 4.0, "button", "", "click")
    assert json.loads(messages.frame(STATE, None))["events"] == []
    assert json.loads(messages.frame(STATE, None, [event]), parse_constant=pytest.fail)["events"] == [
        {"kind": "begun", "finger": 3, "x_mm": -20.5, "y_mm": 4.0, "client": "button", "surface": "", "effect": "click"}
    ]


def test_the_name_of_a_simulated_plate_is_that_in_its_rig_s_directory(tmp_path: Path) -> None:
    assert _name(None) is None
    assert _name(tmp_path) == ""
    write_measured(GroundTruth(PlateSettings.of("fingertip")), 1, tmp_path)
    assert _name(tmp_path) == "fingertip"


def test_the_ground_truth_is_decoded_and_anything_else_is_none() -> None:
    fields = {"t_ns": 5, "fingers": [[1.0, 2.0]], "modal_um": [[1.0, 0.5]], "truth_um": [[0.25, 0.0]]}
    assert decode_truth(msgpack.packb(fields)) == Truth(5, ((1.0, 2.0),), ((1.0, 0.5),), ((0.25, 0.0),))
    for change in ({"t_ns": "x"}, {"fingers": 3}, {"modal_um": [[1.0]]}, {"truth_um": None}):
        assert decode_truth(msgpack.packb(fields | change)) is None


# --- the shapes ---------------------------------------------------------------------------------------------------


def test_the_picture_s_grid_is_the_daemon_s_map_from_the_top_left() -> None:
    modes = GroundTruth(PlateSettings()).measured_mode_map(1)
    body = {
        "x_mm": modes.x_mm.tolist(),
        "y_mm": modes.y_mm.tolist(),
        "modes": modes.M,
        "shapes": modes.shapes.astype("<f4").tobytes(),
    }
    grid = np.frombuffer(picture_grid(modes_of(body), (137.5, 137.5)), "<f4").reshape(2, GRID, GRID)
    np.testing.assert_allclose(grid[:, 0, 0], modes.evaluate([(-68.75, 68.75)])[0], atol=1e-5)
    np.testing.assert_allclose(grid[:, 50, 75], modes.evaluate([(34.375, 0.0)])[0], atol=1e-5)


def test_the_page_of_a_daemon_that_sends_no_friction_curve_has_the_built_in_one() -> None:
    body = {"size_mm": [200.0, 200.0], "w_limit_um": [4.0, 4.0], "modes": 2}
    without, measured = (
        json.loads(messages.plate({**body, **more}, None))["friction_curve"]
        for more in ({}, {"friction_curve": [[0.0, 1.0], [1.5, 0.2]]})
    )
    assert measured == [[0.0, 1.0], [1.5, 0.2]]
    assert without == [[0.0, 1.0], [2.0, pytest.approx(0.0574, abs=1e-4)]]

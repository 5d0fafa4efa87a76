"""Surfaces as the page gets them."""

from __future__ import annotations

import base64
import json
from typing import Any

import pytest

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.tools.view import messages
from hapticd.tools.view.surfaces import SIDE, SurfacePainter

PLATE_MM = (137.5, 137.5)
TILE: dict[str, Any] = {"name": "tile", "amplitude_um": 1.5, "circle_mm": 8.0, "position_mm": [3.0, -4.0], "z": 100}


def painted(*described: dict[str, Any]) -> list[dict[str, Any]]:
    layers = SurfacePainter(DEFAULT_FRICTION_CURVE, PLATE_MM, 4.0).painted(described)
    return list(json.loads(messages.surfaces(layers), parse_constant=pytest.fail)["surfaces"])


def test_a_layer_is_painted_with_its_shape_pose_motion_and_owner() -> None:
    moving = {"velocity_mm_s": [20.0, 0.0], "turning_rad_s": 1.0, "t_pose_ns": 2_500_000_000, "blend": "add"}
    (layer,) = painted({"client": "study", **TILE, **moving})
    assert (layer["client"], layer["name"], layer["about"], layer["amplitude_um"]) == ("study", "tile", "1.50 µm", 1.5)
    assert (layer["shape"], layer["position_mm"], layer["t_pose_s"]) == ({"radius_mm": 8.0}, [3.0, -4.0], 2.5)
    assert (layer["velocity_mm_s"], layer["turning_rad_s"]) == ([20.0, 0.0], 1.0)
    assert (layer["z"], layer["blend"]) == (100, "add")


def test_content_that_varies_is_a_picture_over_the_layer_s_box() -> None:
    grating = {"period_mm": 40.0, "high_um": 1.2, "duty_frac": 0.5}
    (layer,) = painted(
        {"client": "study", "name": "stripes", "grating": grating, "polygon_mm": [[-20, -5], [20, -5], [0, 9]]}
    )
    levels = base64.b64decode(layer["levels"])
    assert (layer["box_mm"], layer["most_um"], len(levels)) == ([40.0, 18.0], 1.2, SIDE * SIDE)
    row = levels[:SIDE]
    assert row == levels[-SIDE:] == bytes(SIDE // 4) + b"\xff" * (SIDE // 2) + bytes(SIDE // 4)

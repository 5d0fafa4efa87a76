"""Friction from a force sensor: what of a recording is a reading, and the curve that readings give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.errors import CalibrationError
from hapticd.tools.calibrate import friction_live
from hapticd.tools.calibrate.friction import fit_friction
from hapticd_client import RefusedError

LEVELS_UM = np.linspace(0.0, 2.8, 8)  # whole tenths, as readings have them
NORMAL_N = 0.5
SPEED_MM_S = 80.0


def coefficient(amplitude_um: np.ndarray) -> np.ndarray:
    return np.asarray(0.2 + 0.6 * np.exp(-amplitude_um / 0.7))


def recorded(channels: tuple[str, ...], *, fingers: int = 1, speed_mm_s: float = SPEED_MM_S) -> dict[str, Any]:
    """Tables of a sweep: a finger strokes to and fro, and a sensor stands under the plate."""
    at_s = np.arange(0.0, 2 * len(LEVELS_UM) * friction_live.HELD_S, 0.01)
    steps = (at_s // friction_live.HELD_S).astype(int)
    amplitude_um = np.concatenate([LEVELS_UM, LEVELS_UM[::-1]])[steps]
    friction = coefficient(amplitude_um)
    forces = {
        "Fx": NORMAL_N * friction * 0.8 * np.where(np.sin(at_s * 5.0) < 0.0, -1.0, 1.0),
        "Fy": NORMAL_N * friction * 0.6,
        "Fz": np.full(len(at_s), -NORMAL_N),
    }
    x_mm = 40.0 - np.abs((speed_mm_s * at_s) % 160.0 - 80.0)
    ids = [np.full(len(at_s), number) for number in range(fingers)]
    order = np.argsort(np.tile(at_s, fingers), kind="stable")
    names = np.array(channels, dtype=object)
    return {
        "fingers": {
            "t_s": np.tile(at_s, fingers)[order],
            "finger_id": np.concatenate(ids)[order],
            "x_mm": np.tile(x_mm, fingers)[order],
            "y_mm": np.zeros(fingers * len(at_s)),
        },
        "targets": {"t_s": at_s, "target_um": amplitude_um, "achieved_um": amplitude_um.copy()},
        "streams": {
            "stream": np.array(["force"] * len(names), dtype=object),
            "channel": np.arange(1, len(names) + 1),
            "name": names,
        },
        "measured": {
            "t_s": np.repeat(at_s, len(names)),
            "stream": np.array(["force"] * len(names) * len(at_s), dtype=object),
            "channel": np.tile(np.arange(1, len(names) + 1), len(at_s)),
            "value": np.stack([forces[name] for name in channels], axis=1).ravel(),
        },
    }


@pytest.mark.parametrize(
    ("channels", "share"), [(("Fx", "Fy", "Fz"), 1.0), (("Fx", "Fy"), NORMAL_N), (("Fy",), 0.6 * NORMAL_N)]
)
def test_a_sweep_gives_the_friction_of_each_amplitude(channels: tuple[str, ...], share: float) -> None:
    amplitude_um, friction, speed_mm_s = friction_live.readings(recorded(channels), "force")
    assert np.unique(amplitude_um) == pytest.approx(LEVELS_UM)
    np.testing.assert_allclose(friction, share * coefficient(amplitude_um), rtol=1e-6)
    assert np.median(speed_mm_s) == pytest.approx(SPEED_MM_S, rel=0.02)
    found = fit_friction(amplitude_um, friction, speed_mm_s)
    assert found.bare == pytest.approx(0.8 * share, rel=0.01)


def test_a_reading_is_of_what_the_finger_got_and_none_where_that_changes_within_it() -> None:
    found = recorded(("Fx", "Fy", "Fz"))
    at_s, achieved_um = found["targets"]["t_s"], found["targets"]["achieved_um"]
    achieved_um[at_s < 24.0] *= 0.5
    amplitude_um, _, _ = friction_live.readings(found, "force")
    assert {round(um, 1) for um in amplitude_um} == {round(um, 1) for um in (*LEVELS_UM, *(0.5 * LEVELS_UM))}
    achieved_um[at_s < 24.0] += 0.3 * np.sign(np.sin(at_s[at_s < 24.0] * 400.0))
    steady, _, _ = friction_live.readings(found, "force")
    assert 0.4 < len(steady) / len(amplitude_um) < 0.65


@pytest.mark.parametrize(
    ("found", "sentence"),
    [
        ({}, "The stream force sent no samples"),
        ({"measured": recorded(("Fx",))["measured"]}, "No finger touched the plate"),
        (recorded(("Fx",), fingers=2), "No finger slid over the plate alone"),
        (recorded(("Fx",), speed_mm_s=1.0), "No finger slid over the plate alone"),
    ],
)
def test_a_recording_without_readings_is_one_sentence(found: dict[str, Any], sentence: str) -> None:
    with pytest.raises(CalibrationError, match=sentence):
        friction_live.readings(found, "force")


def test_the_amplitude_rises_and_falls_over_the_whole_plate_and_is_removed() -> None:
    done: list[object] = []

    class Plate:
        def surface(self, name: str, *, amplitude_um: float) -> None:
            done.append((name, amplitude_um))

        def remove(self, name: str) -> None:
            done.append(name)

    friction_live.sweep(Plate(), [0.0, 1.5], done.append)  # type: ignore[arg-type]
    held = friction_live.HELD_S
    steps = [(friction_live.SURFACE, um) for um in (0.0, 1.5, 1.5, 0.0)]
    assert done == [part for step in steps for part in (step, held)] + [friction_live.SURFACE]


class Reached:
    """A plate of which the right half reaches no friction below `right`, the left one none below `left`."""

    def __init__(self, left: float | None, right: float | None, *, refuses: bool = False) -> None:
        self._lowest, self._refuses = (left, right), refuses

    def plate(self) -> dict[str, Any]:
        return {"size_mm": [200.0, 100.0], "w_limit_um": [5.0, 2.5], "friction_curve": None}

    def reach(self, *, x_mm: float, y_mm: float) -> tuple[float, float] | None:
        if self._refuses:
            raise RefusedError("reach: this plate is driven for points.")
        assert abs(x_mm) <= 70.0
        assert abs(y_mm) <= 35.0
        lowest = self._lowest[x_mm > 0.0]
        return None if lowest is None else (lowest, 1.0)


@pytest.mark.parametrize(
    ("plate", "top_um"),
    [
        (Reached(0.25, 0.25), DEFAULT_FRICTION_CURVE.amplitude_um(0.25)),
        (Reached(0.2, 0.4), DEFAULT_FRICTION_CURVE.amplitude_um(0.3)),
        (Reached(0.0, 0.01), 2.5),  # the curve knows no more: within the limits
        (Reached(0.5, 0.5, refuses=True), 2.5),
    ],
)
def test_the_sweep_rises_to_what_half_of_the_places_reach(plate: Reached, top_um: float) -> None:
    assert friction_live.highest_um(plate) == pytest.approx(top_um)  # type: ignore[arg-type]


@pytest.mark.parametrize("lowest", [None, 0.95])
def test_a_plate_that_gives_next_to_nothing_is_one_sentence(lowest: float | None) -> None:
    with pytest.raises(CalibrationError, match="too little for a curve: release other clients' targets"):
        friction_live.highest_um(Reached(lowest, lowest))  # type: ignore[arg-type]

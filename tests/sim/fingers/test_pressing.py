"""How hard simulated fingers press: in scenarios, files and recordings, as a pad reports it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hapticd.sim.fingers import recorded, trajectories
from hapticd.sim.fingers.pressing import LEAST_RADIUS_MM, MOST_RADIUS_MM, form_of
from hapticd.sim.fingers.scenarios import SCENARIOS, Actor, Scenario
from hapticd.sim.fingers.sensor import SensorModel
from hapticd.sim.settings import Settings
from hapticd.tools.record import simulated
from hapticd.values import Contact
from hapticd.wire.trackpad import Decoder
from hapticd_contract.simulated import USUAL_PRESSURE_FRAC, SimulatedTouch

SIZE_MM = (137.5, 137.5)
HEADER = "t_s,finger,x_mm,y_mm,target_um,pressure_frac"


def reported(actors: tuple[Actor, ...], seconds: float) -> list[tuple[float, Contact]]:
    """What a pad reports of each touching contact, with the instants (s) of its scans."""
    sensor = SensorModel(seed=1)
    paths = [actor.path for actor in actors if actor.path is not None]
    tips = [actor.fingertip for actor in actors if actor.path is not None]
    decoder = Decoder("mt2-usb")
    return [
        (report.t_sample_s, contact)
        for report in sensor.reports(paths, seconds, tips)
        for frame in decoder.decode(report.data, 0)
        for contact in frame.contacts
        if contact.touching
    ]


def written(folder: Path, text: str) -> Path:
    file = folder / "fingers.csv"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_contact_grows_with_the_cube_root_of_pressure_within_bounds() -> None:
    radii_mm = [form_of(SimulatedTouch(0.0, 0.0, share * USUAL_PRESSURE_FRAC))[0] for share in (0.0, 1.0, 2.0, 9.0)]
    np.testing.assert_allclose(radii_mm, [LEAST_RADIUS_MM, 5.0, 5.0 * 2 ** (1 / 3), MOST_RADIUS_MM])


def test_a_file_says_how_hard_each_finger_presses_and_what_its_contact_is(tmp_path: Path) -> None:
    file = written(
        tmp_path,
        f"{HEADER},major_mm,minor_mm,angle_rad\n0.4,1,-40,0,1,0.2,14,10,0\n0.8,1,-20,0,,0.6,14,10,0\n1.2,1,0,0,,,,,\n",
    )
    (actor,) = trajectories.read_repeated(file, SIZE_MM)
    period_s = 1.2 + trajectories.PAUSE_S
    at_s = np.array([0.4, 0.6, 0.8, 1.2, period_s + 0.6])
    assert actor.path is not None
    assert actor.fingertip is not None
    at_mm = actor.path.position_mm(np.array([0.3, 0.6, period_s - 0.1, period_s + 0.6, 7 * period_s + 0.6]))[:, 0]
    np.testing.assert_allclose(at_mm, [np.nan, -30.0, np.nan, -30.0, -30.0], atol=1e-6)
    np.testing.assert_allclose(actor.fingertip.pressure_frac(at_s), [0.2, 0.4, 0.6, USUAL_PRESSURE_FRAC, 0.4])
    still, at_rest = actor.fingertip.ellipses_mm(at_s)[[1, 3]]
    np.testing.assert_allclose(still, [[7.0, 0.0], [0.0, 5.0]])
    np.testing.assert_allclose(at_rest, [[5.0, 0.0], [0.0, 5.0]])


def test_fingers_of_a_recording_press_as_they_were_recorded(tmp_path: Path) -> None:
    pressing = Scenario("press", "", 3.0, SCENARIOS["press"].build)
    simulated.run(pressing, tmp_path / "p.mcap", settings=Settings(), seed=1, seconds=None)
    before = reported(SCENARIOS["press"].build(1, 100.0), 3.0)
    (actor,) = trajectories.read_repeated(tmp_path / "p.mcap", SIZE_MM)
    again = reported((actor,), 3.0)
    hardest, mean_mm = (
        max(contact.pressure_frac for _, contact in again),
        lambda touched: np.mean([contact.major_mm for _, contact in touched]),
    )
    assert hardest == pytest.approx(max(contact.pressure_frac for _, contact in before), abs=0.01)
    assert mean_mm(again) == pytest.approx(mean_mm(before), rel=0.05)
    np.testing.assert_allclose([contact.x_mm for _, contact in again], 0.0, atol=0.5)


def test_one_path_of_a_recording_has_one_touch_at_a_time() -> None:
    touches = recorded._Touches()

    def frame(t_ms: int, *contact_ids: int) -> recorded.TouchFrame:
        contacts = tuple(Contact(i, float(i), 0.0, 6.0, 5.0, 0.0, 0.2, True, 4, 0, 0) for i in contact_ids)
        return recorded.TouchFrame(t_ms * 1_000_000, contacts, False)

    for t_ms, *contact_ids in ((0, 1), (10, 1, 2), (20, 2), (30, 2, 3), (100, 2, 4), (110,)):
        touches.take(frame(t_ms, *contact_ids))
    places = [[row[1] for row in rows if not math.isnan(row[1])] for rows in touches.paths]
    assert places == [[1.0, 1.0, 4.0], [2.0, 2.0, 2.0, 2.0], [3.0]]
    assert all(math.isnan(rows[-1][1]) for rows in touches.paths)

"""Other settings on the same recording: what is unchanged gives the recorded, and a worse predictor leaks more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgpack
import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config.sections import Config
from hapticd.errors import ConfigError
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim.fingers.fingertip import Fingertip
from hapticd.sim.fingers.pad_ellipse import calibrated
from hapticd.sim.plate.glasses import FINGERTIP
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings
from hapticd.tools.record import simulated
from hapticd.tools.record.tracks import tracks
from hapticd.tools.record.whatif import _judge, _recorded, changed, compare, rehearse


def test_predictions_for_a_wrong_instant_leak_more_at_the_true_positions(strokes: Path) -> None:
    fingers, judged = compare(open_recording(strokes), ["trackpad.latency_ms=0", "solver.tolerance_um=0.05"])
    leak_um = {one.name: one.score.leak_um for one in judged}

    assert fingers.is_true
    assert list(leak_um) == ["as recorded", "trackpad.latency_ms=0", "solver.tolerance_um=0.05", "all of these"]
    assert leak_um["trackpad.latency_ms=0"] > 3 * leak_um["as recorded"]
    assert leak_um["as recorded"] < 0.1
    recorded = judged[0].score
    assert recorded.still_friction_change < -0.2 < 0.2 < recorded.slip_friction_change
    assert recorded.weber_frac > 0.9  # two modes keep no contact still


def test_the_ideal_loop_is_near_what_the_plate_did(strokes: Path) -> None:
    recording = open_recording(strokes)
    fingers, judged = compare(recording, ["solver.tolerance_um=0.02"])
    assert fingers.got_um is not None
    still = (fingers.target_um == 0.0) & (fingers.t_ns > fingers.t_ns[0] + 800_000_000)[:, None]
    got_um = float(np.sqrt(np.nanmean(np.abs(fingers.got_um[still]) ** 2)))

    assert got_um == pytest.approx(judged[0].score.leak_um, abs=0.05)  # parasitic modes are not compensated
    assert judged[1].score.leak_um == judged[0].score.leak_um  # the default


def test_contacts_are_judged_by_the_recorded_ellipses(tmp_path: Path) -> None:
    path, tip = tmp_path / "ellipses.mcap", Fingertip(6.0, 3.8, 0.7)
    settings = Settings(plate=PlateSettings.of(FINGERTIP), fingertip=tip, config=calibrated(Config()))
    simulated.run("strokes", path, settings=settings, seed=3, seconds=1.0)
    recording = open_recording(path)
    fingers, (judged,) = compare(recording, [])
    assert fingers.contacts is not None
    for contact in fingers.contacts:
        assert contact.forms_mm(np.array([0.5])) == pytest.approx(tip.forms_mm(np.array([0.5])), abs=0.4)

    made = _recorded(list(recording.records()))
    by_discs, by_truth = (
        _judge(recording, replace(fingers, contacts=contacts), made).contact_leak_um for contacts in (None, [tip, tip])
    )
    assert abs(judged.score.contact_leak_um - by_truth) < 0.5 * abs(by_discs - by_truth)


def test_a_column_has_the_contact_of_the_finger_that_is_in_it() -> None:
    """One finger with an ellipse lifts; the next has none, and is a disc."""

    def passed(t_ms: int, finger_id: int, **ellipse: float) -> Record:
        place = {"finger_id": finger_id, "x_mm": 0.0, "y_mm": 0.0}
        point = place | {"target_um": 1.0} | ellipse
        fields = {"age_ns": 0, "horizon_ns": 0, "fingers": [place], "points": [point]}
        return Record("pass", t_ms, t_ms * 1_000_000, fields)

    ellipse = {"contact_major_mm": 12.0, "contact_minor_mm": 8.0, "contact_angle_rad": np.pi / 2}
    first = [passed(t_ms, 1, **ellipse) for t_ms in range(0, 100, 10)]
    fingers = tracks([*first, *(passed(t_ms, 2) for t_ms in range(200, 300, 10))])

    assert fingers.contacts is not None
    (contact,) = fingers.contacts
    forms_mm = contact.forms_mm(np.array([-0.01, 0.05, 0.25]))
    assert forms_mm == pytest.approx(np.array([np.eye(2) * 5.0, np.diag([4.0, 6.0]), np.eye(2) * 5.0]), abs=1e-12)


def test_a_recorder_that_attached_late_counts_its_fingers_from_one(strokes: Path) -> None:
    """From a moment without fingers on: ids of the recording are by one larger than those of the core that joins."""
    recording = open_recording(strokes)

    def later(record: Record) -> Record:
        fields = dict(record.fields)
        if record.kind == "pass":
            fields["fingers"] = [finger | {"finger_id": finger["finger_id"] + 1} for finger in fields["fingers"]]
        elif record.kind == "targets":
            message = msgpack.unpackb(fields["payload"])
            for target in message.get("targets", ()):
                target["finger"] += 1
            fields["payload"] = msgpack.packb(message)
        return record._replace(fields=fields)

    records = [later(record) for record in recording.records()]

    assert rehearse(recording, records, recording.header.config) == _recorded(records)


def test_a_change_is_a_key_of_the_configuration() -> None:
    config = changed(
        Config(), ["prediction.noise_mm = 0.5", "solver.tolerance_um=0.05", "limits.w_limit_um=[3.0, 2.0]"]
    )

    assert config.prediction.noise_mm == 0.5
    assert config.solver.tolerance_um == 0.05
    assert config.limits.w_limit_um == (3.0, 2.0)


@pytest.mark.parametrize(
    "change",
    [
        "",
        "tolerance_um=1",
        "solver.tolerance_um",
        "solver.tolerance_um=-1",
        "solver.fad=1",
        "solver.policy=x",
        "=.=",
        "plate.size_mm=1",
    ],
)
def test_a_change_that_cannot_be_is_one_sentence(change: str) -> None:
    with pytest.raises(ConfigError) as refused:
        changed(Config(), [change])
    assert str(refused.value).startswith("--set")


def test_the_command_shows_a_table(strokes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(strokes), "--set", "prediction.noise_mm=1.0"]) == 0
    printed = capsys.readouterr().out.splitlines()

    assert [line.split("  ")[0] for line in printed[1:3]] == ["as recorded", "prediction.noise_mm=1.0"]
    assert "the plate is not there" in printed[-1]

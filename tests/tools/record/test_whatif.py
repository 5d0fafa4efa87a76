"""Other settings on the same recording: what is unchanged gives the recorded, and a worse predictor leaks more."""

from __future__ import annotations

from pathlib import Path

import msgpack
import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config.sections import Config
from hapticd.errors import ConfigError
from hapticd.files.recording.kinds import Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.tools.record.whatif import _recorded, changed, compare, rehearse


def test_predictions_for_a_wrong_instant_leak_more_at_the_true_positions(strokes: Path) -> None:
    fingers, judged = compare(open_recording(strokes), ["trackpad.latency_ms=0", "solver.derating_mm2_um2=0"])
    leak_um = {one.name: one.score.leak_um for one in judged}

    assert fingers.is_true
    assert list(leak_um) == ["as recorded", "trackpad.latency_ms=0", "solver.derating_mm2_um2=0", "all of these"]
    assert leak_um["trackpad.latency_ms=0"] > 3 * leak_um["as recorded"]
    assert leak_um["as recorded"] < 0.1
    recorded = judged[0].score
    assert recorded.still_friction_change < -0.2 < 0.2 < recorded.slip_friction_change
    assert recorded.weber_frac > 0.9  # two modes keep no contact still


def test_the_ideal_loop_is_near_what_the_plate_did(strokes: Path) -> None:
    recording = open_recording(strokes)
    fingers, judged = compare(recording, ["solver.derating_mm2_um2=5"])
    assert fingers.got_um is not None
    still = (fingers.target_um == 0.0) & (fingers.t_ns > fingers.t_ns[0] + 800_000_000)[:, None]
    got_um = float(np.sqrt(np.nanmean(np.abs(fingers.got_um[still]) ** 2)))

    assert got_um == pytest.approx(judged[0].score.leak_um, abs=0.03)
    assert judged[1].score.leak_um == judged[0].score.leak_um  # 5 is the default


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
        Config(), ["prediction.noise_mm = 0.5", "solver.derating_mm2_um2=0", "limits.w_limit_um=[3.0, 2.0]"]
    )

    assert config.prediction.noise_mm == 0.5
    assert config.solver.derating_mm2_um2 == 0.0
    assert config.limits.w_limit_um == (3.0, 2.0)


@pytest.mark.parametrize(
    "change",
    [
        "",
        "derating_mm2_um2=1",
        "solver.derating_mm2_um2",
        "solver.derating_mm2_um2=-1",
        "solver.fad=1",
        "solver.policy=x",
        "=.=",
        "plate.finger_decay_1_s=1",
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

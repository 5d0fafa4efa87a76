"""The simulated plate's ground truth in a live recording: each finger with its target; none without a rig."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from hapticd.files.recording.kinds import Fields, Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.tools.record.truth import MAX_PATHS, RigTruth

MESSAGE: dict[str, Any] = {
    "t_ns": 77,
    "paths": 4,
    "path": [0, 2],
    "fingers": [[-20.0, 3.0], [25.0, -1.0]],
    "modal_um": [[1.0, 0.5], [-2.0, 0.0], [0.1, 0.1], [0.2, 0.0]],
    "truth_um": [[0.9, 0.0], [0.01, 0.02]],
}
ANYTHING = st.recursive(
    st.none() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=3) | st.binary(max_size=3),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.sampled_from(sorted(MESSAGE)), part, max_size=6),
    max_leaves=12,
)


@pytest.fixture(scope="module")
def rig_truth(strokes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RigTruth]:
    """Of a rig that never answers."""
    header = open_recording(strokes).header
    sim = replace(header.config.sim, rig_dir=str(tmp_path_factory.mktemp("rig")))
    with zmq.Context() as context:
        made = RigTruth(context, replace(header, config=replace(header.config, sim=sim)))
        yield made
        made.close()


def truth_of(rig_truth: RigTruth, message: object) -> Record | None:
    return rig_truth._record(msgpack.packb(message), 9)


def passed(*points: tuple[int | str, float, float, float]) -> Record:
    """A pass that solved for these points: key, x_mm, y_mm, target_um."""
    names = ("x_mm", "y_mm", "target_um")
    found: list[Fields] = [
        {"virtual" if isinstance(key, str) else "finger_id": key} | dict(zip(names, numbers, strict=True))
        for key, *numbers in points
    ]
    return Record("pass", 8, 5, {"points": found})


def test_a_true_finger_has_the_target_of_the_finger_that_was_seen_there(rig_truth: RigTruth) -> None:
    rig_truth.note(passed((3, 24.0, -2.0, 0.0), (2, -18.0, 3.0, 1.5)))

    assert truth_of(rig_truth, MESSAGE) == Record(
        "truth",
        9,
        77,
        {
            "fingers": [
                {"path": 1, "x_mm": -20.0, "y_mm": 3.0, "plate_d_um": 0.9, "plate_q_um": 0.0}
                | {"finger_id": 2, "target_um": 1.5},
                {"path": 3, "x_mm": 25.0, "y_mm": -1.0, "plate_d_um": 0.01, "plate_q_um": 0.02}
                | {"finger_id": 3, "target_um": 0.0},
            ],
            "modal_um": {"d": [1.0, -2.0], "q": [0.5, 0.0]},  # the driven modes
        },
    )


@pytest.mark.parametrize(
    "change",
    [
        {"paths": 1},
        {"paths": MAX_PATHS + 1},
        {"path": [0]},
        {"t_ns": "now"},
        {"fingers": [[1.0], [2.0]]},
        {"modal_um": [[1.0, None]]},
    ],
)
def test_what_is_no_truth_leaves_no_record(rig_truth: RigTruth, change: dict[str, object]) -> None:
    assert truth_of(rig_truth, MESSAGE | change) is None


@given(ANYTHING | st.dictionaries(st.sampled_from(sorted(MESSAGE)), ANYTHING).map(lambda change: MESSAGE | change))
def test_no_message_of_a_rig_raises(rig_truth: RigTruth, message: object) -> None:
    truth_of(rig_truth, message)

"""The simulated plate's truth beside a live recording: each finger with its target; nothing where there is no rig."""

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

from hapticd.files.recording.framing import RawRecord, Scanner
from hapticd.files.recording.reader import open_recording
from hapticd.files.recording.records import KINDS, Record, record_of
from hapticd.tools.record.truth import MAX_PATHS, TruthEar

TOLD: dict[str, Any] = {
    "t_ns": 77,
    "paths": 4,
    "path": [0, 2],
    "fingers": [[-20.0, 3.0], [25.0, -1.0]],
    "modal_um": [[1.0, 0.5], [-2.0, 0.0], [0.1, 0.1], [0.2, 0.0]],
    "truth_um": [[0.9, 0.0], [0.01, 0.02]],
}
ANYTHING = st.recursive(
    st.none() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text(max_size=3) | st.binary(max_size=3),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.sampled_from(sorted(TOLD)), part, max_size=6),
    max_leaves=12,
)


@pytest.fixture(scope="module")
def ear(strokes: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TruthEar]:
    """Of a rig that never answers."""
    header = open_recording(strokes).header
    sim = replace(header.config.sim, rig_dir=str(tmp_path_factory.mktemp("rig")))
    with zmq.Context() as context:
        made = TruthEar(context, replace(header, config=replace(header.config, sim=sim)))
        yield made
        made.close()


def truth_of(ear: TruthEar, told: object) -> Record | None:
    raw = next(Scanner().feed(ear._framed(msgpack.packb(told), 9)), None)
    return None if raw is None else record_of(*raw)


def passed(*points: list[Any]) -> RawRecord:
    """A pass that solved for these points."""
    fields = [5, 0, 0, "ACTIVE", False, [], list(points), None, 0, []]
    return RawRecord(KINDS["pass"].number, 8, bytes(msgpack.packb(fields)))


def test_a_true_finger_has_the_target_of_the_finger_that_was_seen_there(ear: TruthEar) -> None:
    ear.hear(passed([3, 24.0, -2.0, 0.0, 0.0, 24.5, -2.0], [2, -18.0, 3.0, 1.5, 1.4, -17.0, 3.0]))
    truth = truth_of(ear, TOLD)
    assert truth is not None
    assert truth.seq == 9
    assert truth.fields == (
        77,
        [[-20.0, 3.0], None, [25.0, -1.0], None],
        [1.5, None, 0.0, None],
        [[1.0, 0.5], [-2.0, 0.0]],  # the driven modes
        [[0.9, 0.0], None, [0.01, 0.02], None],
    )


def test_a_finger_that_nobody_asked_for_has_no_target_and_a_virtual_one_is_not_true(ear: TruthEar) -> None:
    ear.hear(passed(["walker", -20.0, 3.0, 2.0, 2.0, -20.0, 3.0], [3, 50.0, -1.0, 0.0, 0.0, 50.0, -1.0]))
    truth = truth_of(ear, TOLD)
    assert truth is not None
    assert truth.fields[2] == [None] * 4


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
def test_what_is_no_truth_leaves_no_record(ear: TruthEar, change: dict[str, object]) -> None:
    assert truth_of(ear, TOLD | change) is None


@given(ANYTHING | st.dictionaries(st.sampled_from(sorted(TOLD)), ANYTHING).map(lambda change: TOLD | change))
def test_no_message_of_a_rig_raises(ear: TruthEar, told: object) -> None:
    truth_of(ear, told)


def test_without_a_rig_nothing_is_heard(strokes: Path) -> None:
    with zmq.Context() as context:
        deaf = TruthEar(context, open_recording(strokes).header)
        deaf.hear(passed([3, 24.0, -2.0, 0.0, 0.0, 24.5, -2.0]))
        assert deaf.records(4) == b""
        deaf.close()

"""Recordings that a stranger made, and sessions longer than a demonstration: judged and drawn, or one sentence."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import h5py
import msgpack
import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.errors import RecordingError
from hapticd.files.recording.framing import HEADER_KIND, MAGIC, Scanner, frame
from hapticd.files.recording.reader import open_recording
from hapticd.files.recording.records import KINDS, Record
from hapticd.sim.lockstep import T_START_NS
from hapticd.tools.record import export, picture
from hapticd.tools.record.tables import tables
from hapticd.tools.record.tracks import tracks

MS = 1_000_000
BEGIN_NS = T_START_NS + 1_000 * MS


def a_pass(t_ns: int, finger_id: int, *, key: int | str | None = None, knots: Sequence[object] = ()) -> list[Any]:
    point = [finger_id if key is None else key, 1.0, 2.0, 1.0, 0.9, 1.0, 2.0]
    fingers = [] if key is not None else [[finger_id, 1, 1.0, 2.0]]
    return [t_ns, 0, 10 * MS, "ACTIVE", False, fingers, [point], t_ns, 0, list(knots)]


def touched(finger_id: int, start_ns: int, passes: int = 20) -> list[Record]:
    return [Record("pass", 0, tuple(a_pass(start_ns + step * 11 * MS, finger_id))) for step in range(passes)]


@pytest.fixture
def strange(strokes: Path, tmp_path: Path) -> Any:
    """Writes a recording of these records, (kind, fields) each, behind the header of an honest one."""

    def write(*records: tuple[str, list[Any]]) -> Path:
        path = tmp_path / "strange.hrec"
        scanner = Scanner()
        header = next(raw for raw in scanner.feed(strokes.read_bytes()[len(MAGIC) :]) if raw.kind == HEADER_KIND)
        numbers = count()
        framed = [frame(KINDS[kind].number, next(numbers), msgpack.packb(fields)) for kind, fields in records]
        path.write_bytes(MAGIC + frame(HEADER_KIND, 0, header.body) + b"".join(framed))
        return path

    return write


def test_fingers_that_follow_each_other_share_a_column_and_are_seen_to_land() -> None:
    first, second = touched(1, BEGIN_NS), touched(2, BEGIN_NS + 300 * MS)
    found = tracks([*first, *second])

    assert found.position_mm.shape[1:] == (1, 2)
    assert np.isnan(found.target_um).any()
    alone = tracks(first)
    np.testing.assert_array_equal(found.target_um[: len(alone.t_ns)], alone.target_um)
    np.testing.assert_array_equal(found.position_mm[: len(alone.t_ns)], alone.position_mm)


def test_fingers_at_once_have_a_column_each() -> None:
    both = [record for pair in zip(touched(1, BEGIN_NS), touched(2, BEGIN_NS + 5 * MS), strict=True) for record in pair]

    assert tracks(both).target_um.shape[1] == 2


def test_an_hour_of_thousands_of_touches_takes_the_room_of_one_finger() -> None:
    records = [record for tap in range(3000) for record in touched(tap + 1, BEGIN_NS + tap * 1000 * MS, passes=2)]
    found = tracks(records)

    assert found.target_um.shape[1] == 1
    assert int((np.diff(np.isfinite(found.target_um[:, 0]).astype(int)) == 1).sum()) == 2999


def test_more_fingers_at_once_than_memory_is_one_sentence() -> None:
    crowd = [
        Record("pass", 0, tuple(a_pass(t_ns, finger)))
        for t_ns in (BEGIN_NS, BEGIN_NS + 3000 * 1000 * MS)
        for finger in range(1, 40)
    ]
    with pytest.raises(RecordingError, match="more fingers than can be judged at once"):
        tracks(crowd)


def test_a_truth_without_fingers_is_one_sentence() -> None:
    truth = [Record("truth", 0, (BEGIN_NS + step * 100 * MS, [], [], [[0.0, 0.0]] * 2, [])) for step in range(3)]
    with pytest.raises(RecordingError, match="no fingers to judge by"):
        tracks(truth)


def test_references_without_knots_are_passed_over(strange: Any, capsys: pytest.CaptureFixture[str]) -> None:
    path = strange(*(("pass", a_pass(BEGIN_NS + step * 11 * MS, 1)) for step in range(20)))

    assert main(["replay", str(path), "--set", "solver.fade=0"]) == 0
    assert "as recorded" in capsys.readouterr().out


@pytest.mark.parametrize("column", [0, 1, 2, 7])
def test_instants_beyond_all_clocks_are_no_records(strange: Any, tmp_path: Path, column: int) -> None:
    fields = a_pass(BEGIN_NS, 1, knots=[[0, [[0.0, 0.0]] * 2]])
    fields[column] = 2**63 - 1
    recording = open_recording(strange(("pass", fields), ("pass", a_pass(BEGIN_NS, 1))))

    export.to_csv(tables(recording), {}, tmp_path / "out")
    assert recording.losses.unreadable == 1


def test_the_largest_instants_that_are_records_have_tables_too(strange: Any) -> None:
    largest = 1 << 61
    fields = a_pass(largest, 1, knots=[[largest, [[0.0, 0.0]] * 2]])
    fields[1], fields[2] = -largest, largest

    found = tables(open_recording(strange(("pass", fields))))
    assert found["predictions"]["t_plate_ns"].tolist() == [3 * largest]
    assert found["references"]["t_knot_ns"].tolist() == [2 * largest] * 2


def test_one_long_message_does_not_make_all_others_as_long(strange: Any, tmp_path: Path) -> None:
    short = ("request", [BEGIN_NS, msgpack.packb({"op": "hello"}), "uid 1"])
    path = strange(("request", [BEGIN_NS, b"\0" * 900_000, "uid 1"]), *[short] * 500)
    found = tables(open_recording(path))

    assert found["messages"]["message_json"].nbytes < 100_000
    export.to_hdf5(found, {}, tmp_path / "out.h5")
    with h5py.File(tmp_path / "out.h5") as file:
        assert file["messages"]["message_json"][1] == b'{"op": "hello"}'
        assert file["messages"]["user"][1] == b"uid 1"


def test_texts_of_strangers_are_drawn_and_no_formulas(strange: Any, tmp_path: Path) -> None:
    formula = r"$\frac$ $x^^$ \$"
    path = strange(
        ("marker", [BEGIN_NS + 5 * MS, formula, formula]),
        *(("pass", a_pass(BEGIN_NS + step * 11 * MS, 1, key=formula)) for step in range(20)),
    )
    picture.draw(tables(open_recording(path)), tmp_path / "out.png", title=formula)
    assert (tmp_path / "out.png").stat().st_size > 0

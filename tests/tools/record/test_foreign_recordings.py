"""Recordings of other programs: exported and drawn, or one sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import pytest

from hapticd.__main__ import main
from hapticd.files.recording.header import Header
from hapticd.files.recording.kinds import Fields, Record
from hapticd.files.recording.mcap_reader import open_recording
from hapticd.sim.lockstep import T_START_NS
from hapticd.tools import plotting
from hapticd.tools.record import export, picture
from hapticd.tools.record.tables import tables

from .conftest import written

MS = 1_000_000
BEGIN_NS = T_START_NS + 1_000 * MS


def a_pass(t_ns: int, finger_id: int, *, virtual: str | None = None, **changes: Any) -> Record:
    """A pass with one finger and without knots."""
    place = {"x_mm": 1.0, "y_mm": 2.0}
    point = place | {"target_um": 1.0, "achieved_um": 0.9, "end_x_mm": 1.0, "end_y_mm": 2.0}
    fields: Fields = {
        "age_ns": 0,
        "horizon_ns": 10 * MS,
        "state": "ACTIVE",
        "is_limited": False,
        "fingers": [] if virtual else [{"finger_id": finger_id, "contact_id": 1, **place}],
        "points": [{"virtual": virtual, **point} if virtual else {"finger_id": finger_id, **point}],
        "t_apply_ns": t_ns,
        "gate_reasons": 0,
        "knots": [],
    }
    return Record("pass", 0, t_ns, fields | changes)


@pytest.fixture
def foreign(header: Header, tmp_path: Path) -> Callable[..., Path]:
    """Writes a recording of these records behind the header of an honest one."""

    def write(*records: Record) -> Path:
        numbered = (record._replace(seq=seq) for seq, record in enumerate(records))
        return written(tmp_path / "foreign.mcap", header, numbered)

    return write


def test_amplitudes_of_unequal_parts_and_points_without_a_key_are_exported_and_drawn(
    foreign: Callable[..., Path], tmp_path: Path
) -> None:
    uneven = [
        {"dt_ns": 0, "modal_um": {"d": [1.0], "q": [0.0, 1.0, 2.0]}},
        {"dt_ns": 5, "modal_um": {"d": [], "q": []}},
    ]
    keyless = [{name: value for name, value in a_pass(0, 1).fields["points"][0].items() if name != "finger_id"}]
    path = foreign(a_pass(BEGIN_NS, 1), a_pass(BEGIN_NS + 500 * MS, 1, knots=uneven, points=keyless))

    assert main(["export", str(path), "--csv", str(tmp_path / "out")]) == 0
    assert main(["export", str(path), "--plot", str(tmp_path / "out.png")]) == 0


@pytest.mark.parametrize("name", ["age_ns", "horizon_ns", "t_apply_ns"])
def test_instants_beyond_all_clocks_are_no_records(foreign: Callable[..., Path], tmp_path: Path, name: str) -> None:
    recording = open_recording(foreign(a_pass(BEGIN_NS, 1, **{name: 2**63 - 1}), a_pass(BEGIN_NS, 1)))

    (tmp_path / "out").mkdir()
    export.to_csv(tables(recording), {}, tmp_path / "out")
    assert recording.losses.unreadable == 1


def test_one_long_message_does_not_make_all_others_as_long(foreign: Callable[..., Path], tmp_path: Path) -> None:
    short = Record("request", 0, BEGIN_NS, {"payload": msgpack.packb({"op": "hello"}), "user": "uid 1"})
    path = foreign(Record("request", 0, BEGIN_NS, {"payload": b"\0" * 900_000, "user": "uid 1"}), *[short] * 500)
    found = tables(open_recording(path))

    assert found["messages"]["message_json"].nbytes < 100_000
    export.to_hdf5(found, {}, tmp_path / "out.h5")
    import h5py

    with h5py.File(tmp_path / "out.h5") as file:
        assert file["messages"]["message_json"][1] == b'{"op": "hello"}'
        assert file["messages"]["user"][1] == b"uid 1"


def test_texts_are_drawn_and_are_no_formulas(foreign: Callable[..., Path], figures: list[Any]) -> None:
    formula = r"$\frac$ $x^^$ \$"
    path = foreign(
        Record("marker", 0, BEGIN_NS + 5 * MS, {"client": formula, "text": formula}),
        *(a_pass(BEGIN_NS + step * 11 * MS, 1, virtual=formula) for step in range(20)),
    )
    picture.draw(tables(open_recording(path)), Path("out.png"), title=formula)
    texts = [text.get_text() for text in figures[0].axes[0].texts if "frac" in text.get_text()]
    assert texts == [plotting.plain(formula)]
    figures[0].canvas.draw()

"""The live view: contents, rate, and robustness against odd states."""

from __future__ import annotations

import io

from hapticd.tools.demo.live_view import COLUMNS, ROWS, LiveView
from hapticd_client import FingerState, PlateState


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def finger(key: int | str, x_mm: float, y_mm: float, target_um: float | None = 1.0) -> FingerState:
    achieved_um = None if target_um is None else target_um * 0.9
    return FingerState(key, x_mm, y_mm, x_mm, y_mm, target_um, achieved_um, isinstance(key, str))


def state(*fingers: FingerState, limited: bool = False) -> PlateState:
    return PlateState(1, 1, 0, "ACTIVE", fingers, (1.5, -2.25), limited, 10.4, 15.6)


SIZE_MM = 137.5, 137.5
STEP_S = 1 / 64  # exact in binary: sums of it are too


def shown(*states: PlateState) -> list[str]:
    """The last picture on a terminal."""
    out = Terminal()
    view = LiveView(out, SIZE_MM)
    for index, each in enumerate(states):
        view.update(each, 100.0 + index * STEP_S)
    return out.getvalue().rpartition("\x1b[J")[2].splitlines()


def test_elsewhere_than_on_a_terminal_it_is_one_line_a_second() -> None:
    out = io.StringIO()
    view = LiveView(out, SIZE_MM)
    for index in range(192):
        view.update(state(finger(1, 0.0, 0.0), finger(2, 9.0, 9.0, 0.0), limited=index > 150), index * STEP_S)
    lines = out.getvalue().splitlines()
    assert len(lines) == 3
    assert lines[1] == "ACTIVE   64.0/s  horizon 15.6 ms  1: 1.00 -> 0.90 um  2: 0.00 -> 0.00 um"
    assert not any("\x1b" in line for line in lines)


def test_a_terminal_is_redrawn_in_place_ten_times_a_second() -> None:
    out = Terminal()
    view = LiveView(out, SIZE_MM)
    for index in range(141):
        view.update(state(finger(1, 0.0, 0.0)), index * STEP_S)
    pictures = out.getvalue().split("\x1b[J")
    assert len(pictures) == 21  # each seventh state
    height = pictures[0].count("\n")
    assert height <= 24  # of a small terminal
    for picture in pictures[:-1]:
        assert picture.endswith(f"\x1b[{height}A\r")


def test_fingers_stand_where_they_are_as_what_they_are() -> None:
    lines = shown(
        state(
            finger(1, -68.75, 68.75), finger(2, 68.75, -68.75, 0.0), finger(3, 0.0, 0.0, None), finger("v", 0.0, 30.0)
        )
    )
    plate = [line[1:-1] for line in lines[1 : ROWS + 1]]
    assert (plate[0][0], plate[-1][-1], plate[ROWS // 2][COLUMNS // 2]) == ("o", "#", "+")
    table = lines[ROWS + 3 : ROWS + 7]
    assert table[0].split() == ["1", "-68.8", "68.8", "1.00", "0.90"]
    assert table[2].split() == ["3", "0.0", "0.0", "-", "-"]
    assert table[3].split()[0] == "v"

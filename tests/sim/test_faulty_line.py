"""The faulty line applies the configured faults, reproducibly."""

from __future__ import annotations

from faulty_line import Line, LineFaults
from hypothesis import given
from hypothesis import strategies as st

WRITES = [bytes((i, 255 - i, i ^ 85)) * 4 for i in range(200)]
MS = 1_000_000


def carried(faults: LineFaults) -> list[tuple[int, bytes]]:
    line = Line(faults, 1)
    return [piece for i, write in enumerate(WRITES) for piece in line(i * MS, write)]


def test_a_line_without_faults_changes_nothing() -> None:
    assert carried(LineFaults()) == [(i * MS, write) for i, write in enumerate(WRITES)]


def test_lost_is_gone_truncated_is_a_beginning_and_corrupted_differs_in_one_to_three_bits() -> None:
    assert carried(LineFaults(lost=1.0)) == []
    whole = dict(enumerate(WRITES))
    assert all(
        whole[t_ns // MS].startswith(data) and len(data) < 12 for t_ns, data in carried(LineFaults(truncated=1.0))
    )
    for t_ns, data in carried(LineFaults(corrupted=1.0)):
        flipped = sum((a ^ b).bit_count() for a, b in zip(data, whole[t_ns // MS], strict=True))
        assert flipped <= 3  # a bit that flips twice is whole again


@given(st.integers(0, 1000), st.integers(0, 100 * MS))
def test_a_delay_is_bounded_and_nothing_overtakes(seed: int, delay_ns: int) -> None:
    line = Line(LineFaults(delayed=0.5, delay_ns=delay_ns), seed)
    arrivals = [t_ns for i in range(50) for t_ns, _ in line(i * MS, b"x")]
    assert arrivals == sorted(arrivals)
    assert all(0 <= arrival - i * MS <= delay_ns for i, arrival in enumerate(arrivals))

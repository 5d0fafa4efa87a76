"""What may lie unread before the board, in numbers and virtual time."""

from __future__ import annotations

from hapticd.core.board.link import BAD_FOR_NS, PATIENT_QUESTION_EVERY_NS, QUESTION_EVERY_NS, QUESTIONS, SendWindow

MS = 1_000_000
T0_NS = 70_000_000_000
PATIENCE_NS = 15 * MS


def wrote(*seqs: int) -> SendWindow:
    """One reference every 11 ms from T0_NS on."""
    flow = SendWindow()
    for index, seq in enumerate(seqs):
        flow.wrote(seq, T0_NS + 11 * index * MS)
    return flow


def test_the_one_that_is_named_was_read_and_all_before_it_across_the_wrap() -> None:
    flow = wrote(0xFFFE, 0xFFFF, 0, 1)
    flow.named(0)
    assert not flow.is_full(T0_NS + 1000 * MS, PATIENCE_NS)
    assert flow.is_overdue(T0_NS + 1000 * MS, PATIENCE_NS)
    flow.named(1)
    assert not flow.is_overdue(T0_NS + 1000 * MS, PATIENCE_NS)


def test_a_line_that_was_known_to_lose_may_hold_twice_as_many_for_a_second() -> None:
    flow = wrote(1, 2, 3, 4)
    t_known_ns = T0_NS + 40 * MS
    flow.read_until(T0_NS, t_known_ns)
    assert not flow.is_full(t_known_ns + 100 * MS, PATIENCE_NS)
    flow.wrote(5, t_known_ns)
    assert flow.is_full(t_known_ns + 100 * MS, PATIENCE_NS)
    flow.named(3)
    assert not flow.is_full(t_known_ns + BAD_FOR_NS - 1, PATIENCE_NS)
    assert flow.is_full(t_known_ns + BAD_FOR_NS, PATIENCE_NS)


def test_questions_come_fast_then_patiently_and_fast_again_after_an_answer() -> None:
    flow = SendWindow()
    asked = [t_ms for t_ms in range(1000) if flow.may_ask(T0_NS + t_ms * MS)]
    fast = range(0, QUESTIONS * QUESTION_EVERY_NS // MS, QUESTION_EVERY_NS // MS)
    assert asked[:QUESTIONS] == list(fast)
    assert asked[QUESTIONS] - asked[QUESTIONS - 1] == PATIENT_QUESTION_EVERY_NS // MS
    assert len(asked) <= QUESTIONS + 10
    flow.answered()
    assert flow.may_ask(T0_NS + 1000 * MS)

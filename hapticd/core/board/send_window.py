"""How much may lie unread before the board: a terminal takes thousands of bytes for one that has stopped reading.

Pure. The board names each reference that took effect, so what was written and is not named after a round trip was lost
or lies there unread. A question tells which: the line keeps the order, and whoever answers has read all before it.
"""

from __future__ import annotations

from collections import deque
from typing import Final

MOST_UNREAD: Final = 2  # references; more are only under way at once where a round trip takes longer than two reports
MOST_ON_A_BAD_LINE: Final = 4  # there silence says less, and the board waits 50 ms for a sign of life
BAD_FOR_NS: Final = 1_000_000_000  # since something was last known to be lost
QUESTION_EVERY_NS: Final = 4_000_000
QUESTIONS: Final = 12  # that fast; whoever has not answered by then has let go of the plate long since
PATIENT_QUESTION_EVERY_NS: Final = 100_000_000


class SendWindow:
    """The references that the board may not have read yet, oldest first, and the questions after them."""

    def __init__(self) -> None:
        self._unread: deque[tuple[int, int]] = deque()
        self._questions = 0
        self._t_question_ns = 0
        self._t_lost_ns = -BAD_FOR_NS

    def clear(self) -> None:
        """The board forgot them all, or is another."""
        self._unread.clear()
        self._questions = 0

    def wrote(self, seq: int, t_now_ns: int) -> None:
        """Reference `seq` went out."""
        self._unread.append((seq, t_now_ns))

    def named(self, seq: int) -> None:
        """The board has this one: it was read, and all before it."""
        if any(seq == unread for unread, _ in self._unread):
            while self._unread.popleft()[0] != seq:
                pass

    def read_until(self, t_ns: int, t_now_ns: int) -> None:
        """The board has read all that was written until then: what it does not name of that was lost on the way."""
        while self._unread and self._unread[0][1] <= t_ns:
            self._unread.popleft()
            self._t_lost_ns = t_now_ns

    def answered(self) -> None:
        """The board spoke: the next silence is another."""
        self._questions = 0

    def is_overdue(self, t_now_ns: int, patience_ns: int) -> bool:
        """The oldest was written longer than `patience_ns` ago."""
        return len(self._unread) > 0 and t_now_ns - self._unread[0][1] > patience_ns

    def is_full(self, t_now_ns: int, patience_ns: int) -> bool:
        """Another one would only be queued."""
        most = MOST_ON_A_BAD_LINE if t_now_ns - self._t_lost_ns < BAD_FOR_NS else MOST_UNREAD
        return len(self._unread) >= most and self.is_overdue(t_now_ns, patience_ns)

    def may_ask(self, t_now_ns: int) -> bool:
        """Whether it is time for a question; it then counts as asked."""
        every_ns = QUESTION_EVERY_NS if self._questions < QUESTIONS else PATIENT_QUESTION_EVERY_NS
        if self._questions > 0 and t_now_ns - self._t_question_ns < every_ns:
            return False
        self._questions += 1
        self._t_question_ns = t_now_ns
        return True

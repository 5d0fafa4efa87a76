"""Send window: bounds the references that a board may not have read yet.

A terminal buffers thousands of bytes for a board that has stopped reading. The board acknowledges each reference that
took effect, so one that is not acknowledged after a round trip was lost or is still unread. A time request decides: the
line keeps the order, so a board that answers it has read everything before it.
"""

from __future__ import annotations

from collections import deque
from typing import Final

MOST_UNREAD: Final = 2  # references; more are only under way at once where a round trip takes longer than two reports
MOST_ON_A_BAD_LINE: Final = 4  # an acknowledgement may be lost there, and the board's dead-man timeout is 50 ms
BAD_FOR_NS: Final = 1_000_000_000  # since the last known loss
QUESTION_EVERY_NS: Final = 4_000_000
QUESTIONS: Final = 12  # at that rate; by then the board's dead-man has tripped
PATIENT_QUESTION_EVERY_NS: Final = 100_000_000


class SendWindow:
    """The references that the board may not have read yet, oldest first, and the requests sent after them."""

    def __init__(self) -> None:
        self._unread: deque[tuple[int, int]] = deque()
        self._questions = 0
        self._t_question_ns = 0
        self._t_lost_ns = -BAD_FOR_NS

    def clear(self) -> None:
        """Reset: the board was reset or replaced."""
        self._unread.clear()
        self._questions = 0

    def wrote(self, seq: int, t_now_ns: int) -> None:
        """Take note that reference `seq` was sent."""
        self._unread.append((seq, t_now_ns))

    def named(self, seq: int) -> None:
        """Take note that the board has this reference, and so has read all before it."""
        if any(seq == unread for unread, _ in self._unread):
            while self._unread.popleft()[0] != seq:
                pass

    def read_until(self, t_ns: int, t_now_ns: int) -> None:
        """Take note that the board has read all that was sent until `t_ns`. Frames missing from the acknowledgement
        were lost."""
        while self._unread and self._unread[0][1] <= t_ns:
            self._unread.popleft()
            self._t_lost_ns = t_now_ns

    def answered(self) -> None:
        """Take note that the board answered: requests start again at the fast rate."""
        self._questions = 0

    def is_overdue(self, t_now_ns: int, patience_ns: int) -> bool:
        """Whether the oldest was sent longer than `patience_ns` ago."""
        return len(self._unread) > 0 and t_now_ns - self._unread[0][1] > patience_ns

    def is_full(self, t_now_ns: int, patience_ns: int) -> bool:
        """Whether another reference would only be queued."""
        most = MOST_ON_A_BAD_LINE if t_now_ns - self._t_lost_ns < BAD_FOR_NS else MOST_UNREAD
        return len(self._unread) >= most and self.is_overdue(t_now_ns, patience_ns)

    def may_ask(self, t_now_ns: int) -> bool:
        """Return whether a request is due; it then counts as sent."""
        every_ns = QUESTION_EVERY_NS if self._questions < QUESTIONS else PATIENT_QUESTION_EVERY_NS
        if self._questions > 0 and t_now_ns - self._t_question_ns < every_ns:
            return False
        self._questions += 1
        self._t_question_ns = t_now_ns
        return True

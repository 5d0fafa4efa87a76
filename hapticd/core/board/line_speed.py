"""The line's speed: a faster one where the board offers it, and the first one again where that fails."""

from __future__ import annotations

from typing import Final

GREETED_WITHIN_NS: Final = 600_000_000  # at the fast speed; the board returns to its first one after 1.2 s
NOISY_FRAMES: Final = 20  # damaged in one session: the line is too fast
FAILED: Final = "the fast line fails: it goes on at the speed of device.baud (check the cable)"


class LineSpeed:
    """The speed of one line, from its opening on."""

    def __init__(self, fast_baud: int) -> None:
        """`fast_baud` is requested of a board that offers it; 0: the line keeps the speed that it was opened with."""
        self.baud = 0  # that the line should have; 0: the one that it was opened with
        self._fast_baud: Final = fast_baud
        self._has_failed = False
        self._t_began_ns = 0
        self._bad_frames = 0  # of the board, as the session began

    def opened(self) -> None:
        """Reset: the line was opened again."""
        self.baud, self._has_failed = 0, False

    def offered(self, baud_max: int) -> int:
        """Return the speed to request of a board that can follow `baud_max`; 0: none."""
        return 0 if self.baud or self._has_failed else min(self._fast_baud, baud_max)

    def change(self, baud: int, t_now_ns: int) -> None:
        """Take another speed; 0: the first one, from now on."""
        self.baud, self._has_failed = baud, baud == 0
        self._t_began_ns = t_now_ns

    def session_began(self, t_now_ns: int) -> None:
        """Take note that the board's hello is awaited from now on."""
        self._t_began_ns = t_now_ns

    def reported(self, bad_frames: int, *, is_first: bool) -> None:
        """Take note of how many frames reached the board damaged."""
        if is_first:
            self._bad_frames = bad_frames
        elif self.baud and bad_frames - self._bad_frames > NOISY_FRAMES:
            self._has_failed = True

    def fails(self, t_now_ns: int, *, is_greeted: bool) -> bool:
        """Whether a fast line damages frames, or the board does not answer on it."""
        is_silent = not is_greeted and t_now_ns - self._t_began_ns > GREETED_WITHIN_NS
        return self.baud > 0 and (self._has_failed or is_silent)

"""Which curve a finger is drawn on. Finger ids count up for ever, so that curves by id would come and go."""

from __future__ import annotations

from collections.abc import Sequence


class Slots:
    """`count` places; a finger keeps its place until it lifts, and the next one takes the first that is free."""

    def __init__(self, count: int) -> None:
        self._taken: list[int | None] = [None] * count

    def assign(self, finger_ids: Sequence[int]) -> tuple[int | None, ...]:
        """The id in each place, None where none is. Fingers beyond the last place wait until one is free."""
        taken = [held if held in finger_ids else None for held in self._taken]
        waiting = [one for one in finger_ids if one not in taken]
        for place, held in enumerate(taken):
            if held is None and waiting:
                taken[place] = waiting.pop(0)
        self._taken = taken
        return tuple(taken)

    def clear(self) -> None:
        """Forget all: another daemon counts its fingers from 1."""
        self._taken = [None] * len(self._taken)

"""Linear assignment of contacts to fingers, for a handful of each.

Shortest augmenting paths with prices (Jonker and Volgenant, A Shortest Augmenting Path Algorithm for Dense and Sparse
Linear Assignment Problems, Computing 38, 1987): O(n^3), so the time for a full hand is bounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

_NOBODY = -1


def least_cost_assignment(costs: Sequence[Sequence[float]]) -> list[tuple[int, int]]:
    """(row, column) pairs of the least total cost, min(rows, columns) of them, ordered by row. Costs are finite."""
    if len(costs) == 0 or len(costs[0]) == 0:
        return []
    if len(costs) > len(costs[0]):
        turned = least_cost_assignment(list(zip(*costs, strict=True)))
        return sorted((row, column) for column, row in turned)
    row_of = [_NOBODY] * len(costs[0])
    row_price = [0.0] * len(costs)
    column_price = [0.0] * len(costs[0])
    for row in range(len(costs)):
        _seat(row, costs, row_of, row_price, column_price)
    return sorted((row, column) for column, row in enumerate(row_of) if row != _NOBODY)


def _seat(
    newcomer: int,
    costs: Sequence[Sequence[float]],
    row_of: list[int],
    row_price: list[float],
    column_price: list[float],
) -> None:
    """Give one more row a column, moving the seated rows along the cheapest path to a free column (Dijkstra)."""
    length = [math.inf] * len(row_of)
    came_from = [_NOBODY] * len(row_of)
    open_columns = set(range(len(row_of)))
    closed = []
    row, column, reached = newcomer, _NOBODY, 0.0
    while row != _NOBODY:
        for other in open_columns:
            through = reached + costs[row][other] - row_price[row] - column_price[other]
            if through < length[other]:
                length[other] = through
                came_from[other] = column
        column = min(open_columns, key=lambda other: (length[other], other))
        open_columns.remove(column)
        closed.append(column)
        row, reached = row_of[column], length[column]

    row_price[newcomer] += reached
    for passed in closed[:-1]:
        row_price[row_of[passed]] += reached - length[passed]
        column_price[passed] -= reached - length[passed]
    while column != _NOBODY:
        previous = came_from[column]
        row_of[column] = newcomer if previous == _NOBODY else row_of[previous]
        column = previous

"""References of a recording as the line that the board followed: frame after frame, each until the next one begins."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from .tables import Column


def in_force(references: Mapping[str, Column]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.complex128]]:
    """Return the corners of the line, `t_ns` (K,) and `modal_um` (K,), from one mode's rows in the table's order.

    A frame ends where the next one begins: between two of its knots, or held beyond the last.
    """
    modal_um = references["reference_d_um"] + 1j * references["reference_q_um"]
    bounds = [*np.flatnonzero(references["knot"] == 0).tolist(), len(modal_um)]
    rows = [slice(begin, end) for begin, end in pairwise(bounds)]
    frames = [(references["t_knot_ns"][part], modal_um[part]) for part in rows]
    frames.sort(key=lambda frame: int(frame[0][0]))
    t_ns, line_um = [], []
    for place, (at_ns, at_um) in enumerate(frames):
        end_ns = frames[place + 1][0][0] if place + 1 < len(frames) else at_ns[-1]
        kept = at_ns < end_ns
        t_ns.append(np.append(at_ns[kept], end_ns))
        line_um.append(np.append(at_um[kept], np.interp(end_ns, at_ns, at_um)))
    return np.concatenate(t_ns), np.concatenate(line_um)

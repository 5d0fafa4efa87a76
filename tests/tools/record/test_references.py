"""The line of the references in the picture: what was sent, and no chord between two frames."""

from __future__ import annotations

import numpy as np

from hapticd.tools.record.picture import in_force

# Start in ns, then knots (dt_ns, amplitude); the third is held beyond its last knot, the fourth overtakes it.
FRAMES = [
    (0, ((0, 0.0), (400, 4.0), (800, 0.0 + 4.0j))),
    (600, ((0, 1.0 - 1.0j), (1000, -1.0))),
    (1500, ((0, 2.0), (100, 3.0))),
    (2000, ((0, 0.0), (500, 0.5))),
]


def table() -> dict[str, np.ndarray]:
    rows = [(start + dt, knot, um) for start, knots in FRAMES for knot, (dt, um) in enumerate(knots)]
    t_ns, knot, um = (np.array(column) for column in zip(*rows, strict=True))
    return {"t_knot_ns": t_ns, "knot": knot, "reference_d_um": um.real, "reference_q_um": um.imag}


def test_the_line_is_the_reference_in_force_at_each_instant() -> None:
    t_ns, line_um = in_force(table())
    at_ns = np.setdiff1d(np.arange(0, 2500, 7), [600, 1500, 2000])  # it steps at the frames' starts
    frames = [max((frame for frame in FRAMES if frame[0] <= t), key=lambda frame: frame[0]) for t in at_ns]
    expected_um = [
        np.interp(t - start, *zip(*knots, strict=True)) for t, (start, knots) in zip(at_ns, frames, strict=True)
    ]

    assert (np.diff(t_ns) >= 0).all()
    np.testing.assert_allclose(np.interp(at_ns, t_ns, line_um), expected_um, atol=1e-12)

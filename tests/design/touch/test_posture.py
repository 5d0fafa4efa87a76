"""What of a pad's pose is its own, by how many sessions there are and how far their postures are apart."""

from __future__ import annotations

import numpy as np

from hapticd.design.touch.posture import pose_share


def test_the_more_sessions_agree_the_larger_is_the_pads_share_and_the_less_the_farther_they_are_apart() -> None:
    one, two, five = (pose_share(np.zeros((sessions, 2))) for sessions in (1, 2, 5))
    assert (one < two).all()
    assert (two < five).all()
    assert (five < 1.0).all()
    apart = pose_share(np.array(((0.8, 0.0), (-0.8, 0.0))))
    assert apart[0] < two[0]
    assert np.array_equal(apart[2:], two[2:])
    assert np.array_equal(pose_share(np.array(((0.8, 0.3),))), one)  # alone it is its own mean

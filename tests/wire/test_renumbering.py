"""Numbers of contacts from a device that gives none."""

from __future__ import annotations

from hapticd.wire.trackpad import PadGeometry
from hapticd.wire.trackpad.evdev import ContactNumbers

PAD = PadGeometry(x_min_raw=0, x_max_raw=1000, y_min_raw=0, y_max_raw=1000, width_mm=100.0, height_mm=100.0)


def test_each_of_two_near_contacts_keeps_its_number_whatever_their_order() -> None:
    numbers = ContactNumbers(PAD)
    left, right = numbers.of([(100, 100), (200, 100)])
    assert left != right
    assert numbers.of([(205, 105), (110, 100)]) == [right, left]


def test_one_that_jumps_too_far_or_lands_later_is_a_new_contact() -> None:
    numbers = ContactNumbers(PAD)
    (first,) = numbers.of([(100, 100)])
    (jumped,) = numbers.of([(900, 900)])
    again, landed = numbers.of([(900, 905), (880, 900)])
    assert again == jumped
    assert len({first, jumped, landed}) == 3

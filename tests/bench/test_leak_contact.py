"""A still finger that is a disc feels less over its contact when the solver knows that it is one."""

from hapticd.bench import leak


def test_whoever_takes_the_finger_for_a_disc_leaks_less_over_its_contact_and_more_at_its_centre() -> None:
    table = leak.contact(seeds=(1,), seconds=3.0)
    point, disc = (table.row(name).figures for name in (leak.POINT, "a disc of 5 mm"))
    assert disc["contact_leak_um"] < point["contact_leak_um"]
    assert disc["leak_um"] > point["leak_um"]

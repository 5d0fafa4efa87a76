"""Who touches the plate: one request on a running machine, for all clients."""

from __future__ import annotations

from machine_bench import SLIPPERY, STICKY, Bench

from hapticd.config.sections import PlateConfig
from hapticd.errors import ConfigError

CURVE_UM = (0.0, 0.4, 1.0)
PERSONS = {"": (PlateConfig(), ""), "anna": (PlateConfig(friction_curve=CURVE_UM), "It is old.")}


def find(name: str) -> tuple[PlateConfig, str]:
    if name not in PERSONS:
        raise ConfigError("There is no such file.")
    return PERSONS[name]


def test_a_person_changes_targets_and_surfaces_at_once_an_unknown_name_nothing() -> None:
    bench = Bench(SLIPPERY, STICKY)
    bench.machine.find_person = find
    bench.run(400)
    bench.send(targets=[{"finger": 1, "friction": 0.5}], surfaces=[{"name": "plate", "friction": 0.5}])
    usual_um = bench.machine.scene.friction_curve.amplitude_um(0.5)
    for name, person, half_um in (
        (None, "", usual_um),
        ("anna", "anna", 0.4),
        ("bob", "anna", 0.4),
        (None, "", usual_um),
    ):
        reply = bench.ask("person", name=name)
        assert reply.get("error") == ("There is no such file." if name == "bob" else None)
        assert reply.get("body", {}).get("note") == {"anna": "It is old.", "bob": None}.get(str(name), "")
        bench.run(60)
        tick = bench.machine.last_tick
        assert tick is not None
        assert [point.target_um for point in tick.points] == [half_um, half_um]
        assert bench.ask("status")["body"]["person"] == person
        assert bench.machine.config.plate == PERSONS[person][0]  # of a recording that begins now

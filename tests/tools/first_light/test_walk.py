"""A commissioning in virtual time: mistakes are named before the loop closes, sound rigs are driven, it is resumed."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.config.sections import SimConfig
from hapticd.design.commissioning.findings import DANGEROUS, Diagnosis, Flaw
from hapticd.errors import CalibrationError
from hapticd.sim.board.board import PlateModel
from hapticd.sim.commissioning.bench import SimulatedTechnician
from hapticd.sim.commissioning.mistakes import KINDS, Mistake, random_mistake
from hapticd.sim.commissioning.rig import FaultyRig
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.virtual_time import in_virtual_time
from hapticd.tools.first_light import pictures, state
from hapticd.tools.first_light.bench import Bench
from hapticd.tools.first_light.front import Unguided
from hapticd.tools.first_light.rigs import PLAYED, Named, PlayedRig, drawn, play, table
from hapticd.tools.first_light.walk import STEPS, place_of, walk

PLATE = SimConfig()
MARGIN = 3  # of each drawing, which the page leaves out
BAD = Mistake(Flaw.SENSOR_INVERTED, (0,))


def test_drawings_and_charts_fit_a_telephone() -> None:
    columns = {step.name: max(len(line) for line in step.picture.splitlines()) - MARGIN for step in STEPS}
    assert max(columns.values()) <= 48, columns
    chart = pictures.chart(np.linspace(2.9e4, 2.94e4, 50), [np.linspace(0.0, 1.0, 50)], "nm/V")
    assert max(len(line) for line in chart.splitlines()) - MARGIN <= 62


def test_twenty_kinds_and_more_are_made_each_of_them_in_turn() -> None:
    assert len(KINDS) == 23
    assert [drawn(seed, 2)[0].cause for seed in range(len(KINDS))] == list(KINDS)
    assert len(drawn(2 * len(KINDS), 4)) == 3
    assert drawn(40, 2) == drawn(40, 2)


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_a_sound_rig_is_driven_to_the_first_touch() -> None:
    for seed in range(3):
        played = play(seed, (), PLATE, has_scope=False)
        assert played.is_driven
        assert (played.named, played.misled, played.is_driven_in_danger) == ((), (), False)


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_each_kind_is_named_before_the_loop_closes_and_the_mended_rig_is_driven() -> None:
    for place, cause in enumerate(KINDS):
        mistake = random_mistake(cause, 2, np.random.default_rng(place))
        played = play(100 + place, (mistake,), PLATE, has_scope=place % 2 == 1)
        assert [one.mistake for one in played.named] == [mistake], cause
        assert played.misled == ()
        assert played.is_driven
        assert not played.is_driven_in_danger


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_three_mistakes_at_once_on_four_modes_are_named() -> None:
    mistakes = (
        Mistake(Flaw.AMPLIFIERS_SWAPPED, (1, 3)),
        Mistake(Flaw.SENSOR_OPEN, (0,)),
        Mistake(Flaw.MAINS_HUM, (), 300),
    )
    played = play(5, mistakes, SimConfig(plate="fingertip", modes=4))
    assert {one.mistake for one in played.named} == set(mistakes)
    assert played.is_driven
    assert not played.is_driven_in_danger


def nothing(*shown: object) -> None:
    del shown


class Idle(SimulatedTechnician):
    """Mends nothing."""

    async def mend(self, findings: Sequence[Diagnosis]) -> bool:
        del findings
        return False


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_the_loop_stays_open_as_long_as_a_dangerous_mistake_is_there(tmp_path: Path) -> None:
    for cause in sorted(DANGEROUS, key=lambda one: one.value):
        rig = FaultyRig(PlateSettings.of("reference"), [random_mistake(cause, 2, np.random.default_rng(3))], 1)
        technician = Idle(rig, 1, has_scope=False)
        bench = Bench(technician, technician.new_link, "the rig", tmp_path, True)
        assert not in_virtual_time(walk(bench, PLAYED, Unguided(), nothing)), cause
        assert not rig.was_driven


class Ringing(FaultyRig):
    """A rig with two modes far beyond the sweep, which each amplifier drives and each sensor hears."""

    FAR_HZ = (-1800.0, 600.0)  # from the drive

    def __init__(self, driven_frac: float) -> None:
        self._driven_frac = driven_frac
        super().__init__(PlateSettings.of("reference"), (), 3)

    def _model(self) -> PlateModel:
        own, driven = super()._model(), slice(self.modes)
        gains, far = np.asarray(own.gain_um_per_v_s)[driven], len(self.FAR_HZ)
        return replace(
            own,
            decay_1_s=np.concatenate([own.decay_1_s[driven], [own.decay_1_s[0]] * far]),
            detuning_rad_s=np.concatenate([own.detuning_rad_s[driven], 2.0 * np.pi * np.array(self.FAR_HZ)]),
            gain_um_per_v_s=np.vstack([gains, np.tile(self._driven_frac * gains.diagonal(), (far, 1))]),
            sensor=np.hstack([np.asarray(own.sensor)[:, driven], np.ones((self.modes, far))]),
        )


def commissioned(rig: FaultyRig, folder: Path) -> tuple[bool, dict[str, str]]:
    """Return whether all steps have passed, and the last sentence of each step."""
    technician, said = SimulatedTechnician(rig, 3, has_scope=False), dict[str, str]()
    bench = Bench(technician, technician.new_link, "the rig", folder, True)
    is_done = in_virtual_time(
        walk(bench, PLAYED, Unguided(), lambda step, result: said.update({step.name: result.judgement.sentence}))
    )
    return is_done, said


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_modes_far_beyond_the_sweep_get_a_slower_law_with_which_the_rig_is_driven(tmp_path: Path) -> None:
    is_done, said = commissioned(Ringing(0.16), tmp_path)
    assert is_done, said
    assert "deadbeat would make the modes swing that no amplifier is for (27405 Hz, 29805 Hz" in said["resonance"]
    assert 'controller = "pi"' in (tmp_path / "hapticd.toml").read_text()


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_the_loop_stays_open_where_no_law_bears_modes_far_beyond_the_sweep(tmp_path: Path) -> None:
    rig = Ringing(0.2)
    is_done, said = commissioned(rig, tmp_path)
    assert not is_done
    assert not rig.was_driven
    assert "damp the modes that no amplifier is for (27405 Hz, 29805 Hz)" in said["resonance"]


def test_what_was_calibrated_before_a_mend_is_measured_again() -> None:
    names = [step.name for step in PLAYED]
    by_name = dict(zip(names, PLAYED, strict=True))
    assert place_of(by_name["limits"], PLAYED) == names.index("answers")
    assert place_of(by_name["stop"], PLAYED) == names.index("stop")


def test_the_table_counts_kinds_and_what_was_named_wrongly() -> None:
    named = Named(BAD, "polarity", is_alone=False)
    rigs = [
        PlayedRig((BAD,), (named,), (), is_driven=True, is_driven_in_danger=False),
        PlayedRig((BAD,), (), ("rest: no",), is_driven=False, is_driven_in_danger=True),
    ]
    text = table(rigs)
    assert "| inverted sensor (dangerous) | 2 | 1 | 1 | polarity 1 |" in text
    assert "2 rigs, 2 mistakes: 1 named; 0 of 1 kinds always." in text
    assert "Named what was sound: 1 times." in text
    assert "dangerous mistake: 1 rigs." in text


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_the_command_names_mends_and_writes_the_configuration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["first-light", "--sim", "--seed", "10", "--mistakes", "1", "--out", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "FAIL: Sensor 0 is inverted" in shown
    assert "Found and mended: inverted sensor (0)." in shown
    assert "All steps have passed: hapticd run --config" in shown
    assert main(["run", "--check", "--config", str(tmp_path / "hapticd.toml")]) == 0
    capsys.readouterr()
    assert main(["first-light", "--sim", "--out", str(tmp_path)]) == 0
    assert "===" not in capsys.readouterr().out  # nothing is left to do


@pytest.mark.long
@pytest.mark.timeout(600)  # on a loaded host
def test_the_command_prints_the_table_of_many_rigs(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["first-light", "--sim", "--rigs", "2", "--seed", "21"]) == 0
    assert "2 rigs, 2 mistakes: 2 named; 2 of 2 kinds always." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "No board is given"),
        (["--rigs", "3", "--port", "/dev/null"], "No board is given"),
        (["--sim", "--port", "/dev/null"], "--sim cannot be combined"),
        (["--sim", "--wiring", "paper"], "--wiring: first-light knows plates with an amplifier"),
    ],
)
def test_a_wrong_call_gets_one_sentence(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["first-light", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_a_state_is_read_back_as_it_was_written(tmp_path: Path) -> None:
    saved = state.Commissioning(True, {"supply": "Right."}, (1.0, None), (Mistake(Flaw.MAINS_HUM, (), 200.0), BAD))
    saved.save(tmp_path)
    assert state.load(tmp_path, is_simulated=True) == saved
    assert state.load(tmp_path / "new", is_simulated=False) == state.Commissioning(False)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        "[" * 10_000,
        '{"version": 2}',
        json.dumps({"version": 1, "is_simulated": True, "passed": {}, "outputs_v": [float("nan")], "mistakes": None}),
        json.dumps(
            {"version": 1, "is_simulated": True, "passed": {}, "outputs_v": [], "mistakes": [["none", [], 1.0]]}
        ),
        json.dumps({"version": 1, "is_simulated": True, "passed": 3, "outputs_v": [], "mistakes": None}),
    ],
)
def test_a_strange_state_is_refused_with_what_to_do(text: str, tmp_path: Path) -> None:
    (tmp_path / state.STATE_FILE).write_text(text, encoding="utf-8")
    with pytest.raises(CalibrationError, match="delete it to begin again"):
        state.load(tmp_path, is_simulated=True)


def test_a_state_of_another_plate_is_refused(tmp_path: Path) -> None:
    state.Commissioning(True).save(tmp_path)
    with pytest.raises(CalibrationError, match="choose another --out"):
        state.load(tmp_path, is_simulated=False)

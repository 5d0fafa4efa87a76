"""`hapticd calibrate all` on a bare rig with mistakes, in virtual time: each is named before the loop closes."""

from __future__ import annotations

import argparse
import asyncio
import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from faulty_rig import FaultyRig
from mistakes import DANGEROUS, KINDS, Mistake, random_mistake

from hapticd.__main__ import main
from hapticd.design.commissioning.findings import Diagnosis, Flaw
from hapticd.errors import HapticdError
from hapticd.sim import bench
from hapticd.sim.board.board import PlateModel
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.tools.calibrate import folder, program
from hapticd.tools.calibrate.bench import Terminal
from hapticd.tools.calibrate.step import Outcome, Step, Verdict, in_order, steps

pytestmark = [pytest.mark.long, pytest.mark.timeout(600)]  # on a loaded host

REFERENCE = PlateSettings.of("reference")
STEPS = [steps()[name] for name in in_order()[: in_order().index("loop") + 1]]
OPEN_LOOP = STEPS[: STEPS.index(steps()["resonance"])]


@dataclass(frozen=True, slots=True)
class Walked:
    """A rig's calibration up to the closed loop: mistakes that were named, what was named wrongly, last sentences."""

    is_done: bool
    named: tuple[Mistake, ...]
    misled: tuple[str, ...]
    said: dict[str, str]


def walked(rig: FaultyRig, out: Path, monkeypatch: pytest.MonkeyPatch, order: Sequence[Step] = STEPS) -> Walked:
    """Calibrate a rig by a technician who mends what is named."""
    named: list[Mistake] = []
    misled: list[str] = []
    said: dict[str, str] = {}

    def keep(verdict: Verdict, options: argparse.Namespace) -> None:
        said[verdict.step] = verdict.sentence
        for finding in verdict.findings:
            found = rig.found(finding.causes, finding.wires)
            named.extend(one for one in found if one not in named)
            misled.extend([] if found else [f"{verdict.step}: {finding.sentence}"])
        folder.save(options.out, verdict)

    with monkeypatch.context() as patched:
        patched.setattr(bench, "SimulatedBench", lambda _: rig)
        patched.setattr(program, "keep", keep)
        parser = argparse.ArgumentParser("hapticd calibrate")
        parser.epilog = ""
        program.add_arguments(parser)
        options = parser.parse_args(["--sim", "all", "--out", str(out), "--points", "21", "--dwell", "66"])
        folder.prepare(out, is_simulated=True)
        outcome = program.walk(order, options, [step.name for step in order])
    return Walked(outcome is not Outcome.FAIL, tuple(named), tuple(misled), said)


def test_sound_rig_is_driven_without_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = FaultyRig(REFERENCE, (), 0, has_scope=False)
    found = walked(rig, tmp_path, monkeypatch)
    assert found.is_done, found.said
    assert (found.named, found.misled, rig.was_driven, rig.is_driven_in_danger) == ((), (), True, False)


@pytest.mark.parametrize("place", range(len(KINDS)), ids=lambda place: KINDS[place].name.lower())
def test_each_mistake_is_named_and_mended_before_the_loop_closes(
    place: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mistake = random_mistake(KINDS[place], 2, np.random.default_rng(place))
    rig = FaultyRig(REFERENCE, (mistake,), 100 + place, has_scope=place % 2 == 1)
    found = walked(rig, tmp_path, monkeypatch, OPEN_LOOP)
    assert (found.named, found.misled) == ((mistake,), ())
    assert found.is_done, found.said
    assert (rig.mistakes, rig.was_driven) == ([], False)


def test_three_mistakes_at_once_on_four_modes_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    swapped, hum = Mistake(Flaw.AMPLIFIERS_SWAPPED, (1, 3)), Mistake(Flaw.MAINS_HUM, (), 300)
    mistakes = {swapped, Mistake(Flaw.SENSOR_OPEN, (0,)), hum}
    rig = FaultyRig(PlateSettings.of("fingertip", 4), mistakes, 5)
    found = walked(rig, tmp_path, monkeypatch, OPEN_LOOP)
    assert (set(found.named), found.is_done, rig.mistakes) == (mistakes, True, []), found.said


class Unmended(FaultyRig):
    """A rig whose technician mends nothing."""

    def mend(self, findings: Sequence[Diagnosis]) -> bool:
        del findings
        return False


@pytest.mark.parametrize("cause", sorted(DANGEROUS, key=lambda one: one.value), ids=lambda one: one.name.lower())
def test_loop_stays_open_as_long_as_a_dangerous_mistake_is_there(
    cause: Flaw, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mistake = random_mistake(cause, 2, np.random.default_rng(3))
    rig = Unmended(REFERENCE, [mistake], 1, has_scope=False)
    assert not walked(rig, tmp_path, monkeypatch).is_done
    assert not rig.was_driven


class Ringing(FaultyRig):
    """A rig with two modes far beyond the sweep, which each amplifier drives and each sensor sees."""

    FAR_HZ = (-1800.0, 600.0)  # from the drive

    def __init__(self, driven_frac: float) -> None:
        self._driven_frac = driven_frac
        super().__init__(REFERENCE, (), 3, has_scope=False)

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


@pytest.mark.parametrize(("driven_frac", "is_done"), [(0.16, True), (0.2, False)])
def test_modes_far_beyond_the_sweep_get_a_slower_law_or_the_loop_stays_open(
    driven_frac: float, is_done: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Ringing(driven_frac)
    found = walked(rig, tmp_path, monkeypatch)
    assert "(27405 Hz, 29805 Hz" in found.said["resonance"]
    assert (found.is_done, rig.was_driven) == (is_done, is_done), found.said
    assert ('controller = "pi"' in (tmp_path / "hapticd.toml").read_text()) is is_done


def test_all_goes_on_at_the_step_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = Unmended(REFERENCE, [Mistake(Flaw.PATCH_CRACKED, (0,), 0.5)])
    monkeypatch.setattr(bench, "SimulatedBench", lambda _: rig)
    command = ["calibrate", "all", "--sim", "--out", str(tmp_path)]
    for first in ("1 of 12: supplies", "4 of 12: limits"):
        assert main(command) == 1
        assert capsys.readouterr().out.strip("= \n").startswith(first)
    assert [*folder.load(tmp_path)] == ["supplies", "sensors", "wires", "limits"]
    assert folder.load(tmp_path)["limits"].findings[0].causes == (Flaw.PATCH_CRACKED,)


def test_what_a_mended_flaw_may_have_changed_is_measured_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran: list[str] = []

    def run_step(step: Step, options: argparse.Namespace) -> Verdict:
        ran.append(step.name)
        outcome = Outcome.FAIL if len(ran) == 2 else Outcome.PASS
        verdict = Verdict(step.name, outcome, "", (), {}, is_simulated=True)
        folder.save(options.out, verdict)
        return verdict

    monkeypatch.setattr(program, "run_step", run_step)
    monkeypatch.setattr(
        program, "_is_mended", lambda *_: ran == ["wires", "limits"] and len(folder.load(tmp_path)) == 2
    )
    chosen = [steps()["wires"], steps()["limits"]]
    options = argparse.Namespace(out=tmp_path, sim=True)
    assert program.walk(chosen, options, ["wires", "limits"]) is Outcome.PASS
    assert ran == ["wires", "limits", "wires", "limits"]


def test_a_plate_that_was_calibrated_before_needs_no_steps_of_a_bare_rig() -> None:
    resonance = Verdict("resonance", Outcome.PASS, "", (), {}, is_simulated=False)
    supplies = replace(resonance, step="supplies")
    assert folder.left({})[:2] == ["supplies", "sensors"]
    assert folder.left({"resonance": resonance})[0] == "modes"
    assert folder.left({"supplies": supplies, "resonance": resonance})[0] == "sensors"
    assert folder.left({}, "paper")[0] == "resonance"


def test_answers_are_numbers_or_nothing_and_nonsense_is_asked_for_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("about three\nnan\n3.31\n1,65\n\n"))
    person = Terminal()
    assert asyncio.run(person.read_supply(0)) == 3.31
    assert asyncio.run(person.read_idle(1)) == 1.65
    assert asyncio.run(person.read_output(0, 1.0)) is None
    assert "'about three' is no number of volts" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["q\n", ""])
def test_q_and_the_end_of_input_stop_with_how_to_go_on(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(text))
    with pytest.raises(HapticdError, match="goes on here"):
        Terminal().mend([])

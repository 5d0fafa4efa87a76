"""Many simulated rigs with random mistakes: how often each kind was named, and at which step."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...config.sections import SimConfig
from ...design.commissioning.findings import DANGEROUS, Flaw
from ...sim.commissioning.bench import SimulatedTechnician
from ...sim.commissioning.mistakes import KINDS, Mistake, random_mistakes
from ...sim.commissioning.rig import FaultyRig
from ...sim.plate.ground_truth import PlateSettings
from ...sim.virtual_time import in_virtual_time
from .bench import Bench
from .front import Unguided
from .pad_steps import MAP
from .step import PageResult, StepPage
from .walk import STEPS, walk

MOST_MISTAKES: Final = 3
PLAYED: Final = tuple(
    step for step in STEPS if step is not MAP
)  # the map's scan has no mistakes, and takes the longest


@dataclass(frozen=True, slots=True)
class Named:
    """A mistake that was named: at which step, and whether another cause was named as likely."""

    mistake: Mistake
    step: str
    is_alone: bool


@dataclass(frozen=True, slots=True)
class PlayedRig:
    """A rig's commissioning. `misled` are the sentences that named what was sound; `is_driven` holds if it ended with
    the last step."""

    mistakes: tuple[Mistake, ...]
    named: tuple[Named, ...]
    misled: tuple[str, ...]
    is_driven: bool
    is_driven_in_danger: bool


def play(seed: int, mistakes: Sequence[Mistake], plate: SimConfig, *, has_scope: bool = True) -> PlayedRig:
    """Commission a rig with these mistakes in virtual time, by a technician who mends what is named."""
    rig = FaultyRig(PlateSettings.of(plate.plate, plate.modes or None), mistakes, seed)
    technician = SimulatedTechnician(rig, seed, has_scope=has_scope)
    named: list[Named] = []
    misled: list[str] = []

    def on_result(step: StepPage, result: PageResult) -> None:
        for finding in result.judgement.findings:
            found = rig.found(finding.causes, finding.wires)
            before = [one.mistake for one in named]
            named.extend(Named(one, step.name, len(finding.causes) == 1) for one in found if one not in before)
            if not found:
                misled.append(f"{step.name}: {finding.sentence}")

    with tempfile.TemporaryDirectory(prefix="hapticd-first-light-") as folder:
        bench = Bench(technician, technician.new_link, "the simulated rig", Path(folder), True, plate=plate)
        is_done = in_virtual_time(walk(bench, PLAYED, Unguided(), on_result))
    return PlayedRig(tuple(mistakes), tuple(named), tuple(misled), is_done and rig.was_driven, rig.is_driven_in_danger)


def drawn(seed: int, modes: int) -> tuple[Mistake, ...]:
    """Return the mistakes of rig `seed`: each kind in turn, and with the turns one to MOST_MISTAKES at a time."""
    return random_mistakes(seed, modes, 1 + seed // len(KINDS) % MOST_MISTAKES)


def table(played: Sequence[PlayedRig]) -> str:
    """Return the table of kinds, and the sums below it."""
    made = Counter(one.cause for rig in played for one in rig.mistakes)
    named = {cause: [one for rig in played for one in rig.named if one.mistake.cause is cause] for cause in Flaw}
    lines = ["| mistake | made | named | as one of two | at step |", "|---|---|---|---|---|"]
    for cause in KINDS:
        if made[cause]:
            found = named[cause]
            steps = ", ".join(f"{step} {count}" for step, count in Counter(one.step for one in found).most_common())
            pairs = sum(not one.is_alone for one in found)
            danger = " (dangerous)" if cause in DANGEROUS else ""
            lines.append(f"| {cause.value}{danger} | {made[cause]} | {len(found)} | {pairs} | {steps} |")
    whole = sum(made[cause] == len(named[cause]) for cause in made)
    return "\n".join(
        [
            *lines,
            "",
            f"{len(played)} rigs, {made.total()} mistakes: {sum(map(len, named.values()))} named; "
            f"{whole} of {len(made)} kinds always.",
            f"Named what was sound: {sum(len(rig.misled) for rig in played)} times.",
            f"Loop closed with a dangerous mistake: {sum(rig.is_driven_in_danger for rig in played)} rigs.",
            f"Driven to the first touch: {sum(rig.is_driven for rig in played)} rigs.",
        ]
    )

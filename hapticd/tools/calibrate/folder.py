"""Results directory of the calibration: one result per step, and the configuration merged from all of them.

`hapticd.toml` is rewritten after every step from the results that did not fail. Its file names are relative, so the
directory can be moved as a whole.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from ...config import loader as config
from ...config import person
from ...errors import CalibrationError, ConfigError, reason
from ...regular_file import read_bounded
from ...sim.plate.wirings import IDENTITY
from ..outputs import check, create_folder, has_mark, write_text
from .step import FoundSettings, Outcome, Verdict, in_order
from .step import steps as all_steps

CONFIG_FILE = person.FILE
MAX_BYTES = 1 << 20  # of a result
HEADER = "# Written by `hapticd calibrate`, and overwritten by each of its steps: copy it before you change it.\n"


def prepare(
    directory: Path,
    steps: Sequence[str] = (),
    inputs: Iterable[Path] = (),
    *,
    is_simulated: bool,
    is_forced: bool = False,
) -> None:
    """Create the directory, and check that its results are of the same plate and that `steps` may write theirs.

    A step replaces its own earlier result, and no other file. Raises CalibrationError, UsageError.
    """
    create_folder(directory)
    done, given = load(directory), list(inputs)
    for step, verdict in done.items():
        if verdict.is_simulated != is_simulated:
            plate = "the simulated plate" if verdict.is_simulated else "a real plate"
            raise CalibrationError(f"{directory}: its result of {step} is of {plate}: choose another --out.")
    for step in steps:
        check(_files(directory, step), inputs=given, is_forced=is_forced or step in done)
    if steps:
        check([directory / CONFIG_FILE], is_forced=is_forced or has_mark(directory / CONFIG_FILE, HEADER.encode()))


def load(directory: Path) -> dict[str, Verdict]:
    """Read the results in the steps' order. Raises CalibrationError."""
    found = {}
    for step in all_steps():
        path = directory / f"{step}.json"
        if path.exists():
            try:
                found[step] = msgspec.json.decode(read_bounded(path, MAX_BYTES), type=Verdict)
            except (OSError, ValueError, RecursionError) as error:
                why = f"cannot be read ({reason(error)})"
                raise CalibrationError(f"{path}: {why}: delete it and repeat the step.") from None
    return found


def save(directory: Path, verdict: Verdict) -> Path:
    """Write the step's result and the merged configuration; return the latter's path. Raises HapticdError."""
    path, result = directory / CONFIG_FILE, msgspec.json.encode(verdict, enc_hook=float)  # of NumPy's numbers
    write_text(msgspec.json.format(result, indent=2).decode() + "\n", directory / f"{verdict.step}.json")
    write_text(HEADER + as_toml(merged(load(directory).values())), path)
    return path


def accepted(verdict: Verdict) -> Verdict:
    """Return the verdict, as failed if the service refuses its settings, which would invalidate all others."""
    if verdict.outcome is Outcome.FAIL:
        return verdict
    table = {section: dict(keys) for section, keys in verdict.settings.items() if section != person.SECTION}
    for section, key, of_another_step in (("plate", "modes_file", "modes.npz"), ("trackpad", "source", "hid")):
        table.setdefault(section, {}).setdefault(key, of_another_step)  # a real board is refused without them
    try:
        config.from_table(table, where=verdict.step, folder=None)
    except ConfigError as error:
        sentence = str(error).removeprefix(f"{verdict.step}: ")
        return replace(verdict, outcome=Outcome.FAIL, sentence=f"{sentence} Check the units.")
    return verdict


def merged(verdicts: Iterable[Verdict]) -> dict[str, dict[str, Any]]:
    """Merge the settings of all results that did not fail, by section."""
    sections: dict[str, dict[str, Any]] = {}
    for verdict in verdicts:
        if verdict.outcome is not Outcome.FAIL:
            for section, keys in verdict.settings.items():
                sections.setdefault(section, {}).update(keys)
    return sections


def as_toml(settings: FoundSettings) -> str:
    """Return lines for the service's configuration. TOML writes strings, numbers, booleans and lists as JSON does."""
    return "".join(
        f"\n[{section}]\n"
        + "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in keys.items())
        for section, keys in settings.items()
    )


def forget(directory: Path, steps: Iterable[str]) -> None:
    """Delete what steps wrote of a rig that was mended since."""
    for step in steps:
        for path in _files(directory, step):
            path.unlink(missing_ok=True)


def _files(directory: Path, step: str) -> list[Path]:
    return [directory / name for name in (f"{step}.json", f"{step}.png", *all_steps()[step].files)]


def in_all(done: Mapping[str, Verdict], wiring: str | None = None) -> list[str]:
    """Return the names of all steps that `all` takes in order: without a bare rig's where the plate was calibrated
    before, or its amplifiers and sensors are not one for each mode."""
    is_bare = wiring in (None, IDENTITY) and ("supplies" in done or not _has_passed(done, "resonance"))
    return [step for step in in_order() if is_bare or not all_steps()[step].is_of_bare_rig]


def left(done: Mapping[str, Verdict], wiring: str | None = None) -> list[str]:
    """Return the names of those that have not passed yet."""
    return [step for step in in_all(done, wiring) if not _has_passed(done, step)]


def _has_passed(done: Mapping[str, Verdict], step: str) -> bool:
    return step in done and done[step].outcome is not Outcome.FAIL


def overview(directory: Path, *, is_simulated: bool = False) -> str:
    """Return the steps in order, with the results so far, and the command for the next ones."""
    found = load(directory)
    lines = [f"Steps, in this order; results go to {directory} (--out):", ""]
    for place, (step, one) in enumerate(all_steps().items(), 1):
        lines.append(f"{'Later:' if one.order is None else f'{place}.':>6} {step:<10} {one.summary}")
        if step in found:
            done = f"   done{' (simulated)' if found[step].is_simulated else ''}"
            lines.append(f"{done}: {found[step].outcome.name}: {found[step].sentence}")
    if next_steps := left(found):
        arguments = f"{'--sim' if is_simulated else '--port /dev/ttyACM0'} --out {directory}"
        example = arguments if is_simulated else all_steps()[next_steps[0]].example.replace("DIR", str(directory))
        lines += ["", f"Next: hapticd calibrate {next_steps[0]} {example}"]
        lines += [f"All of them, in order: hapticd calibrate all {arguments}"]
    else:
        lines += ["", f"All steps are done: hapticd run --config {directory / CONFIG_FILE}"]
    return "\n".join(lines)

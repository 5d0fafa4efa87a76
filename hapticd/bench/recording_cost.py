"""What a recording costs the touch: paced passes with and without the background writer, in turns."""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

from ..daemon.recorder import header_of
from ..files.recording.background import BackgroundWriter
from ..files.recording.kinds import record_of
from ..files.recording.mcap_writer import RecordingFile
from ..sim.fingers.scenarios import LAND_S, SCENARIOS, SPEED_MM_S
from .recording import Recording, WaitUntil, new_machine, play, record, sleep_until
from .tables import Table, finite_rows
from .tick import PERIOD_S
from .timing import no_garbage_collection

NONE, TO_FILE = "no recording", "to a file"
ROUNDS = 5
_SETTLE_S = 0.5  # from landing to the first pass that counts


def run(*, seconds: float = 2.0, rounds: int = ROUNDS, wait_until: WaitUntil = sleep_until) -> Table:
    """Pace two moving fingers for `seconds` in each of `rounds`, without a recording and with one."""
    limit = max(round(seconds / PERIOD_S), 1)
    situation = record(SCENARIOS["strokes"].build(1, SPEED_MM_S), seconds=LAND_S + _SETTLE_S + limit * PERIOD_S)
    passes: dict[str, list[tuple[float, float]]] = {NONE: [], TO_FILE: []}
    with no_garbage_collection(), tempfile.TemporaryDirectory(prefix="hapticd-bench-") as folder:
        for number in range(rounds):
            passes[NONE] += _round(situation, limit, wait_until, None)
            passes[TO_FILE] += _round(situation, limit, wait_until, Path(folder, f"{number}.mcap"))
        held = _held_us(situation, Path(folder, "held.mcap"))
    rows = {name: _figures(found) for name, found in passes.items()}
    rows[TO_FILE] |= {"held_us": statistics.mean(held), "held_p99_us": held[int(0.99 * len(held))]}
    return Table(
        name="recording",
        title="recording: passes of two moving fingers at 88.9 Hz, and the thread that writes them",
        default=NONE,
        rows=finite_rows(list(rows.items())),
        compared=("paced_us", "paced_p99_us", "late_p99_us"),
        notes=(
            "late: from when a pass is due to its start",
            "held: CPU time in which the thread makes MCAP of one record, and a pass would wait for the interpreter",
        ),
    )


def _round(situation: Recording, limit: int, wait_until: WaitUntil, path: Path | None) -> list[tuple[float, float]]:
    """How long each pass took and how late it began, in us."""
    late_us: list[float] = []

    def wait(t_ns: int) -> None:
        wait_until(t_ns)
        late_us.append((time.monotonic_ns() - t_ns) * 1e-3)

    machine = new_machine(situation)
    writer: BackgroundWriter | None = None
    if path is not None:
        header = header_of(machine, t_ns=situation.calls[0].t_ns, utc="", is_whole=True)
        writer = BackgroundWriter(RecordingFile(path, header))
        machine.observer = writer.put
    taken_us = play(situation, machine, wait_until=wait, limit=limit)
    if writer is not None:
        writer.close(situation.calls[-1].t_ns, "over")
    return list(zip(taken_us, late_us, strict=False))


def _held_us(situation: Recording, path: Path) -> list[float]:
    """The writing thread's CPU time for each record, in order of length."""
    records: list[tuple[str, int, tuple[Any, ...]]] = []
    machine = new_machine(situation)
    machine.observer = lambda kind, t_ns, *values: records.append((kind, t_ns, values))
    play(situation, machine)
    file = RecordingFile(path, header_of(machine, t_ns=situation.calls[0].t_ns, utc="", is_whole=True))
    held_us = []
    for seq, (kind, t_ns, values) in enumerate(records):
        t_begin_ns = time.thread_time_ns()
        file.add(record_of(kind, seq, t_ns, values))
        held_us.append((time.thread_time_ns() - t_begin_ns) * 1e-3)
    file.close()
    return sorted(held_us)


def _figures(passes: list[tuple[float, float]]) -> dict[str, float]:
    taken_us, late_us = (sorted(column) for column in zip(*passes, strict=True))
    last = int(0.99 * len(taken_us))
    return {
        "paced_us": statistics.median(taken_us),
        "paced_p99_us": taken_us[last],
        "late_us": statistics.median(late_us),
        "late_p99_us": late_us[last],
    }

"""Trials of a study for other programs, in a folder named as BIDS has it.

BIDS (bids.neuroimaging.io, behavioural experiments) has a table for each participant, `sub-P03_task-NAME_beh.tsv`, with
the meanings of its columns in a JSON file. Its labels are letters and digits alone. Recordings of the same sessions
lie next to them, as `sub-P03_task-NAME_physio.mcap`, several as `sub-P03_task-NAME_run-1_physio.mcap`.
"""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from . import __version__
from .experiment import StudyError

BIDS_VERSION: Final = "1.9.0"
DESCRIPTION: Final = "dataset_description.json"
MEANINGS: Final[Mapping[str, str]] = {
    "trial": "number of the trial, from 1",
    "presented": "the right answer",
    "answer": "the answer that was given",
    "recognised": "1: the answer was right",
    "t_unix_s": "time of day of the answer, seconds since 1970",
    "took_s": "seconds from the beginning of the trial to the answer",
    "touched_s": "seconds in which the finger was on the plate",
    "speed_mm_s": "mean speed of the finger on the plate",
    "limited_frac": "share of that time in which the plate missed its targets",
    "felt_friction": "mean friction under the finger, 0 the most slippery, 1 bare glass",
    "pressure_frac": "mean pressure of the finger, by the pad's own measure, 0 .. 1",
    "t_daemon_ns": "the trial's end on the daemon's monotonic clock, as recordings have it",
    "simulated": "what was simulated: plate, participant, or nothing",
}
_ABSENT: Final = "n/a"
_MOST_PARTS: Final = 100  # recordings of a session that was interrupted

Row = Mapping[str, Any]


def write_bids(
    rows: Sequence[Row], task: str, folder: Path, sessions: Path | None = None, *, is_forced: bool = False
) -> list[Path]:
    """Write the folder, with the recordings that lie in `sessions`, and return its files. Raises StudyError for one
    with other files, OSError."""
    texts = _files(rows, _label(task))
    paths = {folder / name: text for name, text in texts.items()}
    if not is_forced and folder.exists() and not (folder / DESCRIPTION).is_file() and any(folder.iterdir()):
        raise StudyError(f"{folder}: holds other files: give an empty folder, or add --force.")
    for path, text in paths.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    recorded = {} if sessions is None else _recordings(rows, _label(task), sessions)
    for name, path in recorded.items():
        _put(path, folder / name)
    return [*paths, *(folder / name for name in recorded)]


def _files(rows: Sequence[Row], task: str) -> dict[str, str]:
    """Return the text of each file by its path in the folder."""
    people = dict.fromkeys(str(row["participant"]) for row in rows)
    labels = {person: _label(person) for person in people}
    if len(set(labels.values())) < len(labels):
        raise StudyError("BIDS names participants by letters and digits alone, and two would be alike: rename one.")
    columns = [name for name in rows[0] if name != "participant"]
    about = {name: {"Description": MEANINGS.get(name, "level of this factor")} for name in columns}
    description = {
        "Name": task,
        "BIDSVersion": BIDS_VERSION,
        "DatasetType": "raw",
        "GeneratedBy": [{"Name": "hapticd-study", "Version": __version__}],
    }
    found = {
        DESCRIPTION: _json(description),
        "participants.tsv": _tsv([["participant_id"], *[[f"sub-{label}"] for label in labels.values()]]),
        f"task-{task}_beh.json": _json({"TaskName": task, **about}),
    }
    for person, label in labels.items():
        own = [[row[name] for name in columns] for row in rows if str(row["participant"]) == person]
        found[f"sub-{label}/beh/sub-{label}_task-{task}_beh.tsv"] = _tsv([columns, *own])
    return found


def _recordings(rows: Sequence[Row], task: str, sessions: Path) -> dict[str, Path]:
    """Return the recordings of each participant's session by their paths in the folder."""
    found: dict[str, Path] = {}
    for person in dict.fromkeys(str(row["participant"]) for row in rows):
        named = [sessions / f"{person}{part}.mcap" for part in ("", *(f".{n}" for n in range(2, _MOST_PARTS)))]
        parts = [path for path in named if path.is_file()]
        label = _label(person)
        for number, path in enumerate(parts, 1):
            run = f"_run-{number}" if len(parts) > 1 else ""
            found[f"sub-{label}/beh/sub-{label}_task-{task}{run}_physio.mcap"] = path
    return found


def _put(path: Path, there: Path) -> None:
    """Give a file a second name, or copy it to another disk."""
    there.unlink(missing_ok=True)
    try:
        os.link(path, there)
    except OSError:
        shutil.copyfile(path, there)


def _label(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9]", "", name) or "study"


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, indent=2) + "\n"


def _tsv(rows: Sequence[Sequence[object]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerows([[_ABSENT if value is None or value == "" else value for value in row] for row in rows])
    return text.getvalue()

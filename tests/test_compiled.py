"""The touch path as machine code and as Python: the same bytes to the board, and never code of an older source."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

import pytest

from hapticd import compiled
from hapticd.bench.recording import play, record
from hapticd.compiled import why_interpreted
from hapticd.compiled.build_ext import touch_path
from hapticd.daemon.machine import Machine
from hapticd.daemon.settings import pipeline_settings
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.plate.ground_truth import PlateSettings
from hapticd.sim.settings import Settings, scheme_config

ROOT = Path(__file__).parents[1]
MODULES = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in touch_path(ROOT)]
PLAYED = ("strokes", "both-slip", "virtual-finger")
POINTS, CONTACTS = Settings(), Settings(plate=PlateSettings.of("fingertip"))
TIGHT = {"tolerance_um": 1e-4, "max_knots": 20}


def said() -> dict[str, str]:
    """By scenario a digest of all that is written to the board and published, and how much it is."""
    digests = {}
    for name, plate, changes in (*((name, POINTS, ({}, TIGHT)) for name in PLAYED), ("strokes", CONTACTS, ({},))):
        seconds = 0.8 if plate is POINTS else 0.5  # as Python, contacts take a hundred times as long
        recording = record(SCENARIOS[name].build(3, 130.0), settings=plate, seed=3, seconds=seconds)
        config = scheme_config(plate)
        for pipeline in changes:
            digest = hashlib.sha256()
            written: list[int] = []

            def write(data: bytes, digest: hashlib._Hash = digest, written: list[int] = written) -> bool:
                digest.update(data)
                written.append(len(data))
                return True

            settings = replace(pipeline_settings(config), **pipeline)
            machine = Machine(config, recording.modes, write_board=write, publish=digest.update, pipeline=settings)
            play(recording, machine)
            what = f"{len(config.limits.w_limit_um)} modes, {settings.max_knots} knots"
            digests[f"{name}, {what}"] = f"{digest.hexdigest()}, {sum(written)} bytes"
    return digests


def run_as(pure: str) -> dict[str, object]:
    environment = {**os.environ, "HAPTICD_PURE": pure}
    done = subprocess.run([sys.executable, __file__], env=environment, stdout=subprocess.PIPE, check=True)
    digests: dict[str, object] = json.loads(done.stdout)
    return digests


def test_machine_code_says_to_the_board_what_python_says_byte_for_byte() -> None:
    pure, fast = run_as("1"), run_as("0")
    assert pure["pipeline"] == "pipeline.py"
    assert fast["pipeline"] == ("pipeline.py" if why_interpreted() else f"pipeline{EXTENSION_SUFFIXES[0]}")
    assert pure["said"] == fast["said"]
    assert len(set(dict(pure["said"]).values())) > len(PLAYED)  # type: ignore[call-overload]


@pytest.mark.skipif(why_interpreted() != "", reason=f"Python runs: {why_interpreted()}")
@pytest.mark.parametrize("name", MODULES)
def test_what_the_rule_names_is_compiled(name: str) -> None:
    assert str(import_module(name).__file__).endswith(EXTENSION_SUFFIXES[0])


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package whose `core` has one compiled module, next to a `pyproject.toml` as in a checkout."""
    monkeypatch.setattr(compiled, "PACKAGE", tmp_path)
    monkeypatch.setattr(compiled, "PROJECT", tmp_path / "pyproject.toml")
    monkeypatch.delenv("HAPTICD_PURE", raising=False)
    for name in (
        "pyproject.toml",
        "core/trajectory/gate.py",
        f"core/trajectory/gate{EXTENSION_SUFFIXES[0]}",
        "core/targets/assets.py",
    ):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        os.utime(path, ns=(1000, 1000))
    return tmp_path


def test_a_source_edited_after_the_build_runs_as_python(checkout: Path) -> None:
    os.utime(checkout / "core/trajectory/gate.py", ns=(1001, 1001))
    assert "edited after the build" in why_interpreted()


def test_python_runs_where_it_is_asked_for(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert checkout.exists()
    monkeypatch.setenv("HAPTICD_PURE", "1")
    assert "HAPTICD_PURE" in why_interpreted()
    monkeypatch.setenv("HAPTICD_PURE", "0")
    assert why_interpreted() == ""


if __name__ == "__main__":
    pipeline = import_module("hapticd.core.pipeline")
    print(json.dumps({"pipeline": Path(str(pipeline.__file__)).name, "said": said()}))

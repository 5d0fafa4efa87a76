"""Predictors on recorded touches: the file's format, the tables, and the command."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from hapticd.__main__ import main
from hapticd.bench import prediction_traces
from hapticd.errors import UsageError
from hapticd.sim.fingers.paths import Strokes
from hapticd.tools.touches import Trace
from hapticd.values import FloatArray


def stroked(device: str, seed: int) -> Trace:
    """Strokes on a pad that averages its positions."""
    rng = np.random.default_rng(seed)
    t_s: FloatArray = np.arange(300) / 100.0
    xy_mm = Strokes(seed, 100.0).position_mm(t_s) + 0.05 * rng.standard_normal((len(t_s), 2))
    return Trace(device, t_s[1:], np.asarray(0.5 * (xy_mm[1:] + xy_mm[:-1])))


STROKED = [stroked("kind/one", 1), stroked("kind/one", 2), stroked("hid/maker_0001_0002", 3)]


def arrays(some: list[Trace]) -> dict[str, np.ndarray]:
    return {
        "t_s": np.concatenate([trace.t_s for trace in some]),
        "xy_mm": np.concatenate([trace.xy_mm for trace in some]),
        "trace": np.repeat(np.arange(len(some)), [len(trace.t_s) for trace in some]),
        "device": np.array([trace.device for trace in some]),
    }


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "traces.npz"
    np.savez(path, **arrays(STROKED))
    return path


def test_a_file_is_read_as_it_was_written_one_device_after_the_other(file: Path) -> None:
    found = prediction_traces.load(file)
    assert [trace.device for trace in found] == ["hid/maker_0001_0002", "kind/one", "kind/one"]
    assert [trace.group for trace in found] == ["maker", "kind", "kind"]
    assert [trace.kind for trace in found] == ["hid", "kind", "kind"]
    assert np.array_equal(found[0].xy_mm, STROKED[2].xy_mm)
    assert {name: len(some) for name, some in prediction_traces.by_device(found).items()} == {
        "hid/maker_0001_0002": 1,
        "kind/one": 2,
    }


@pytest.mark.parametrize(
    ("name", "change", "problem"),
    [
        ("xy_mm", lambda _: np.zeros(3), "two columns"),
        ("trace", lambda _: np.array([2, 1, 0]), "must not decrease|one entry"),
        ("trace", np.flip, "must not decrease"),
        ("device", lambda _: np.array(["kind/one"]), "count the names"),
        ("t_s", lambda t_s: t_s * np.nan, "finite"),
        ("xy_mm", None, "cannot be read"),
    ],
)
def test_a_file_of_another_form_is_refused_with_what_is_wrong(
    tmp_path: Path, name: str, change: Callable[[np.ndarray], np.ndarray] | None, problem: str
) -> None:
    held = arrays(STROKED)
    values = held.pop(name)
    if change is not None:
        held[name] = change(values)
    path = tmp_path / "wrong.npz"
    np.savez(path, **held)
    with pytest.raises(UsageError, match=problem):
        prediction_traces.load(path)


def test_the_table_has_every_group_and_the_default_wins_on_a_filtering_pad() -> None:
    by_group, covariance = prediction_traces.run(sorted(STROKED, key=lambda trace: trace.device))
    assert [row.name for row in by_group.rows] == ["kind", "maker", prediction_traces.ALL]
    figures = by_group.row(prediction_traces.ALL).figures
    assert figures["over_the_better_15ms"] < 0.9
    assert figures["over_the_better_25ms"] < 0.9
    assert figures["predictions_count"] == sum(len(trace.t_s) - 2 - 3 for trace in STROKED)
    assert 0.55 < covariance.row("all").figures["within_15ms_frac"] < 0.8


def test_the_command_prints_both_tables_and_their_figures(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "prediction", "--traces", str(file), "--json", str(tmp_path / "figures.json")]) == 0
    printed = capsys.readouterr().out
    assert "by group of devices" in printed
    assert "within one deviation" in printed
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert set(figures["parts"]["prediction"]) == {"prediction_traces", "prediction_covariance"}


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["tick", "--traces", "F"], "belong to one part"),
        (["prediction", "--traces", "F", "--recording", "G"], "exclude each other"),
        (["prediction", "--traces", "F", "--plot", "p.png"], "leave the option out"),
        (["prediction", "--traces", "F"], "cannot be read"),
    ],
)
def test_options_that_do_not_fit_are_refused(
    arguments: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", *arguments]) == 2
    assert problem in capsys.readouterr().err

"""`hapticd doctor latency`: figures of frames with known delays, and one run on the simulated rig."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest
from machine_bench import MS, SLIPPERY, STICKY, Bench
from pictures import faults

from hapticd.config.sections import Config
from hapticd.tools import latency, latency_felt
from hapticd.tools.latency import STAGES, MeasuredLatency, draw, figures, gather, print_table


def test_each_frame_has_its_report_and_the_instant_at_which_the_board_applied_it(measured: MeasuredLatency) -> None:
    assert len(measured.lines) > 30
    for line in measured.lines:
        assert line.t_sent_ns - line.t_sample_ns == line.age_ns  # no time passes within a pass of the bench
        assert 9 * MS <= line.age_ns <= 12 * MS
        assert line.t_sample_ns < line.t_sent_ns <= line.t_applied_ns + MS
        assert line.horizon_ns >= line.age_ns
    assert [line.t_sent_ns for line in measured.lines] == sorted({line.t_sent_ns for line in measured.lines})


def test_the_total_is_from_the_sample_to_the_plate(measured: MeasuredLatency) -> None:
    total_ns = [line.t_applied_ns - line.t_sample_ns for line in measured.lines]
    assert measured.stages["total"].count == len(total_ns)
    assert measured.stages["total"].longest_ns == max(total_ns)
    assert set(measured.stages) == set(STAGES)
    assert measured.counts["frames"] == measured.stages["late"].count


def test_frames_that_the_board_never_applies_are_counted() -> None:
    bench = Bench(SLIPPERY, STICKY).driven()
    for _ in range(1500):  # the bench's board acknowledges one frame in ten
        bench.machine.pipeline.invalidate_reference()
        bench.run(1)
    counts = gather(bench.machine, ()).counts
    assert counts["frames unanswered"] > counts["frames"] > 0


def test_the_table_has_a_row_for_each_stage_with_its_figures(measured: MeasuredLatency) -> None:
    out = io.StringIO()
    print_table(measured, out)
    head, *rows, counts = out.getvalue().splitlines()
    assert head.split() == ["ms", "p50", "p95", "p99", "max"]
    assert [row[:20].strip() for row in rows] == list(STAGES.values())
    horizon = next(row for row in rows if row.startswith(STAGES["horizon"]))
    assert float(horizon[20:28]) == pytest.approx(measured.stages["horizon"].percentile_ns(50) * 1e-6, abs=1e-3)
    assert counts.startswith(f"{measured.counts['frames']} frames, ")


def test_the_figures_say_the_same_as_the_run(measured: MeasuredLatency) -> None:
    plain = json.loads(json.dumps(figures(measured)))
    assert plain["stages"]["link"]["count"] == measured.stages["link"].count
    assert plain["counts"] == dict(measured.counts)
    assert plain["processor_percent"] is None


def test_the_picture_has_the_verdict_as_title_and_a_row_for_each_stage(
    measured: MeasuredLatency, tmp_path: Path, figures: list[Any]
) -> None:
    draw(measured, tmp_path / "latency.png")
    (axes,) = figures[0].axes
    median_ms = measured.stages["total"].percentile_ns(50) * 1e-6
    late, frames = measured.counts["frames late"], measured.counts["frames"]
    assert f"{100 * (1 - late / frames):.1f} % of {frames} frames were on time" in axes.get_title(loc="left")
    assert f"sample to plate took {median_ms:.1f} ms" in axes.get_title(loc="left")
    assert [label.get_text() for label in axes.get_yticklabels()] == list(STAGES.values())
    medians_ms = [line.get_xdata()[0] for line in axes.lines if line.get_color() == "black"]
    assert medians_ms == [measured.stages[name].percentile_ns(50) * 1e-6 for name in STAGES]
    assert faults(figures[0]) == []


def test_what_if_a_faster_pad_and_line_give_more_and_all_are_in_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"RATES_HZ": (60.0, 240.0), "AGES_MS": (3.0,), "SEEDS": (1,), "SECONDS": 2.0}.items():
        monkeypatch.setattr(latency_felt, name, value)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0})  # in this process
    found, out = latency_felt.table(), io.StringIO()
    slow, *_, fast = found.values()
    assert slow + 0.03 < fast
    latency_felt.print_table(found, out)
    cells = [f"{100 * share:.0f}" for share in found.values()][2:]
    assert out.getvalue().splitlines()[-1].split() == ["240", "Hz", *cells]
    assert latency_felt.figures(found)[0] == {"report_hz": 60.0, "age_ms": 3.0, "link_ms": 5.0, "felt_frac": slow}


@pytest.mark.long
def test_the_simulated_rig_is_measured_as_it_is_built(capsys: pytest.CaptureFixture[str]) -> None:
    latency.run(Config(), 2.0, json_file="-", plot=None)
    output = capsys.readouterr()
    figures = json.loads(output.out)
    stages = figures["stages"]
    assert 0.0 < figures["processor_percent"] < 100.0
    assert f"{figures['processor_percent']:.1f} % of one processor" in output.err
    assert stages["link"]["p50_ms"] >= 4.8  # the rig's constant 5 ms, less what the clocks err by
    assert stages["read_age"]["p50_ms"] >= 9.8  # and its sensor's 10
    assert stages["total"]["p50_ms"] >= 14.6  # one after the other
    assert stages["wire"]["count"] > 20
    assert "sample to plate" in output.err

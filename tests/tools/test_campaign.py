"""Campaigns: the same results whoever plays the tasks, and whoever is killed meanwhile."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import campaign_tasks
import msgspec
import numpy as np
import pytest
from campaign_tasks import Outcome, Task, play, times_played

from hapticd.errors import HapticdError, UsageError
from hapticd.tools.campaign import engines, results, runner
from hapticd.tools.campaign.runner import Campaign

SEEDS = range(12)


def tasks_in(folder: Path, **of_seed_4: Any) -> list[Task]:
    folder.mkdir(exist_ok=True)
    return [Task(seed, str(folder), **of_seed_4 if seed == 4 else {}) for seed in SEEDS]


def bits(outcomes: list[Outcome]) -> list[bytes]:
    """What the tables are made of."""
    return [results.encode(outcome[:3]) for outcome in outcomes]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    return bits(Campaign()("seeds", play, tasks_in(tmp_path_factory.mktemp("alone"))))


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """A scheduler and two workers on loopback."""
    distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50, host="127.0.0.1"
    ) as started:
        yield started.scheduler_address


def test_results_keep_type_order_and_last_bit(tmp_path: Path) -> None:
    (outcome,) = Campaign()("seeds", play, [Task(2, str(tmp_path))])
    drawn = np.random.default_rng(2).standard_normal((3, 4))
    assert type(outcome) is Outcome
    assert outcome.total == float(np.exp(drawn).sum())
    assert outcome.worst == float("inf")
    assert np.array_equal(outcome.drawn, drawn.T)


def test_two_processes_give_the_results_of_one_and_have_one_blas_thread(tmp_path: Path, expected: list[bytes]) -> None:
    outcomes = Campaign(2)("seeds", play, tasks_in(tmp_path))
    assert bits(outcomes) == expected
    assert os.getpid() not in {outcome.process for outcome in outcomes}
    assert {outcome.blas_threads for outcome in outcomes} == {"1"}


def test_a_task_whose_process_is_killed_is_played_again(tmp_path: Path, expected: list[bytes]) -> None:
    assert bits(Campaign(2)("seeds", play, tasks_in(tmp_path, deaths=2))) == expected
    assert times_played(tmp_path, 4) == 3


def test_a_task_that_kills_each_process_ends_the_campaign_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(HapticdError, match=r"Task 5 of 12 lost its process 3 times .*--jobs\."):
        Campaign(2)("seeds", play, tasks_in(tmp_path, deaths=9))
    assert times_played(tmp_path, 4) == engines.LOSSES


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_of_a_task_is_the_campaigns(jobs: int, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seed 4 has no plate"):
        Campaign(jobs)("seeds", play, tasks_in(tmp_path, fails=True))


# --- a cluster ---


def test_a_cluster_gives_the_results_of_one_process(cluster: str, tmp_path: Path, expected: list[bytes]) -> None:
    outcomes = Campaign(cluster=cluster)("seeds", play, tasks_in(tmp_path))
    assert bits(outcomes) == expected
    assert os.getpid() not in {outcome.process for outcome in outcomes}
    assert {outcome.blas_threads for outcome in outcomes} == {"1"}


def test_so_it_does_when_a_worker_is_killed(cluster: str, tmp_path: Path, expected: list[bytes]) -> None:
    assert bits(Campaign(cluster=cluster)("seeds", play, tasks_in(tmp_path, deaths=1))) == expected
    assert times_played(tmp_path, 4) == 2


def test_no_worker_holds_a_result_that_was_fetched_which_its_loss_would_repeat(cluster: str, tmp_path: Path) -> None:
    played = engines.by_cluster(play, {bytes((task.seed,)): task for task in tasks_in(tmp_path)}, cluster)
    fetched = [next(played) for _ in SEEDS[1:]]
    with pytest.importorskip("distributed").Client(cluster, set_as_default=False) as client:
        # A scheduler repeats what a client holds; that it does not any more it hears within some of these round trips.
        held = min(sum(map(len, client.has_what().values())) for _ in range(100))
    assert held <= 1
    assert len({*fetched, *played}) == len(SEEDS)


def test_an_error_of_a_task_on_a_cluster_is_the_campaigns(cluster: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="seed 4 has no plate"):
        Campaign(cluster=cluster)("seeds", play, tasks_in(tmp_path, fails=True))


def test_an_address_without_a_scheduler_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="needs the extra `cluster`")
    monkeypatch.setattr(engines, "CONNECT_S", 0.2)
    for address in ("tcp://127.0.0.1:9", "127.0.0.1:nine", "nonsense://somewhere"):
        with pytest.raises(UsageError, match=r"--cluster: no scheduler answers at .*start one with `dask scheduler`"):
            Campaign(cluster=address)("seeds", play, tasks_in(tmp_path))


def test_without_dask_the_sentence_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(HapticdError, match=r"--cluster needs Dask's distributed: run `.* install .*distributed"):
        Campaign(cluster="tcp://127.0.0.1:9")("seeds", play, tasks_in(tmp_path))


class Connected:
    """A client of a scheduler and a worker that may differ from it."""

    def __init__(self, scheduler: dict[str, str | None], worker: dict[str, str | None], threads: int = 1) -> None:
        own = {"python": "3.11.7.final.0", "numpy": "2.3.0", "hapticd": "0.1.0", "distributed": "2026.8.0"}
        parts = {"client": {}, "scheduler": scheduler, "tcp://b:1": worker}
        found = {name: {"packages": own | changed} for name, changed in parts.items()}
        self._found = {**found, "workers": {"tcp://b:1": found.pop("tcp://b:1")}}
        self._threads = {"tcp://b:1": threads} if threads else {}

    def nthreads(self) -> dict[str, int]:
        return self._threads

    def get_versions(self, packages: list[str]) -> dict[str, Any]:
        assert packages == ["hapticd"]
        return self._found


def test_a_worker_or_scheduler_with_another_version_is_named() -> None:
    engines._check(Connected({"python": "3.11.7.candidate.1"}, {}), "tcp://a:1")
    for scheduler, worker, sentence in (
        ({"python": "3.12.1.final.0"}, {}, "The scheduler has python 3.12.1, this campaign 3.11.7: "),
        ({}, {"hapticd": "0.0.9"}, "The worker tcp://b:1 has hapticd 0.0.9, this campaign 0.1.0: install the same"),
        ({}, {"numpy": None}, "The worker tcp://b:1 has no numpy, this campaign 2.3.0: "),
    ):
        with pytest.raises(HapticdError, match=sentence):
            engines._check(Connected(scheduler, worker), "tcp://a:1")


def test_a_cluster_needs_workers_of_one_thread() -> None:
    for threads, sentence in (
        (0, "The cluster tcp://a:1 has no worker: start `dask"),
        (8, "start it with --nthreads 1"),
    ):
        with pytest.raises(HapticdError, match=sentence):
            engines._check(Connected({}, {}, threads), "tcp://a:1")


def test_a_worker_with_other_sources_of_the_same_version_plays_nothing(tmp_path: Path) -> None:
    task = Task(1, str(tmp_path))
    assert engines._play(play, task, results.code_of(play))
    with pytest.raises(HapticdError, match="has other sources of hapticd than this campaign"):
        engines._play(play, task, "others")
    assert times_played(tmp_path, 1) == 1


# --- results that are kept ---

CAMPAIGN = """
import sys
from pathlib import Path
from campaign_tasks import Task, play
from hapticd.tools.campaign.runner import Campaign
folder, cache, jobs = sys.argv[1:]
with Campaign(int(jobs), cache=Path(cache)) as campaign:
    campaign("seeds", play, [Task(seed, folder, ends_all=seed == 4) for seed in range(12)])
"""


def test_a_campaign_that_was_killed_plays_only_what_is_missing(tmp_path: Path, expected: list[bytes]) -> None:
    folder, cache = tmp_path / "tasks", tmp_path / "cache"
    command = [sys.executable, "-c", CAMPAIGN, str(folder), str(cache), "2"]
    tasks = tasks_in(folder, ends_all=True)
    path = os.pathsep.join([str(Path(campaign_tasks.__file__).parent), *sys.path])
    # Its output ends when the last of its processes has ended.
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, timeout=60, check=False)
    assert done.returncode < 0
    (file,) = cache.iterdir()
    kept = results.Results(file)
    before = {task.seed for task in tasks if results.key_of(play, task) in kept}
    kept.close()
    assert before < {*SEEDS} - {4}
    assert len(before) >= 3  # two run at the same time, so when task 5 begins one of the four before it runs at most
    with Campaign(2, cache=cache) as campaign:
        assert bits(campaign("seeds", play, tasks)) == expected
    assert all(times_played(folder, seed) == 1 for seed in before)
    assert times_played(folder, 4) == 2
    assert [*cache.iterdir()] == []  # a finished campaign leaves nothing


def test_an_error_leaves_what_was_played_for_the_next_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tasks = tasks_in(tmp_path / "tasks", fails=True)
    for _ in range(2):
        with pytest.raises(ValueError, match="seed 4"), Campaign(cache=tmp_path / "cache") as campaign:
            campaign("seeds", play, tasks)
    assert [times_played(tmp_path / "tasks", seed) for seed in range(6)] == [1, 1, 1, 1, 2, 0]
    assert capsys.readouterr().err.splitlines() == [
        "What was played is kept: the same command goes on from there.",
        "seeds: 4 of 12 were played before.",
    ]


def test_kept_results_serve_later_calls_with_more_tasks(tmp_path: Path, expected: list[bytes]) -> None:
    tasks, file = tasks_in(tmp_path / "tasks"), tmp_path / "kept.results"
    for count in (5, 12, 12):
        with Campaign(keep=file) as campaign:
            assert bits(campaign("seeds", play, tasks[:count])) == expected[:count]
    assert [times_played(tmp_path / "tasks", seed) for seed in SEEDS] == [1] * 12


def test_equal_tasks_have_one_key_and_other_code_has_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = str(tmp_path)
    key = results.key_of(play, (Task(1, folder), folder))
    assert results.key_of(play, (Task(1, folder), str(tmp_path))) == key  # not the same object twice
    assert results.key_of(play, (Task(2, folder), folder)) != key
    assert results.key_of(times_played, (Task(1, folder), folder)) != key
    monkeypatch.setattr(results, "_digest", lambda package, _: f"edited {package}")
    assert results.key_of(play, (Task(1, folder), folder)) != key


def test_of_a_file_that_ends_within_a_result_the_rest_is_used(tmp_path: Path) -> None:
    file = tmp_path / "kept.results"
    tasks = tasks_in(tmp_path / "tasks")[:3]
    with Campaign(keep=file) as campaign:
        campaign("seeds", play, tasks)
    whole = file.read_bytes()
    for end in range(0, len(whole), 7):
        file.write_bytes(whole[:end])
        kept = results.Results(file)
        kept.close()
        assert whole.startswith(file.read_bytes())
    with Campaign(keep=file) as campaign:
        campaign("seeds", play, tasks)
    assert file.read_bytes()[: len(whole) - 200] == whole[: len(whole) - 200]
    assert [times_played(tmp_path / "tasks", seed) for seed in range(3)] == [1, 1, 2]


def test_a_file_of_something_else_is_refused_and_left_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "letter.txt"
    file.write_text("Dear Sir")
    with pytest.raises(UsageError, match="has no results of a campaign: name another file"):
        Campaign(keep=file)("seeds", play, tasks_in(tmp_path / "tasks"))
    assert file.read_text() == "Dear Sir"
    with pytest.raises(UsageError, match=r"cannot keep results \(Is a directory\)"):
        Campaign(keep=tmp_path)("seeds", play, tasks_in(tmp_path / "tasks"))


def test_two_campaigns_do_not_write_one_file_at_the_same_time(tmp_path: Path) -> None:
    file = tmp_path / "kept.results"
    first = results.Results(file)
    with pytest.raises(UsageError, match="another campaign writes its results there"):
        Campaign(keep=file)("seeds", play, [Task(2, str(tmp_path))])
    first.close()


def test_a_result_of_another_shape_is_an_error() -> None:
    decode = results.decoder(play)
    for result in (
        b"",
        b"\xc1",
        msgspec.msgpack.encode([1.0, ["<f8", [9], b""], None, 1, "1"]),
        results.encode({"a": 1}),
    ):
        with pytest.raises(HapticdError, match="delete the file of results"):
            decode(result)


def test_a_cache_that_cannot_be_written_is_done_without(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with Campaign(cache=tmp_path / "file" / "cache") as campaign:
        assert len(campaign("seeds", play, tasks_in(tmp_path / "tasks"))) == 12


def test_what_was_stopped_a_month_ago_is_deleted(tmp_path: Path) -> None:
    old, new = tmp_path / "old.results", tmp_path / "new.results"
    for path, t_s in ((old, 1e9), (new, None)):
        path.touch()
        os.utime(path, None if t_s is None else (t_s, t_s))
    with Campaign(cache=tmp_path) as campaign:
        campaign("seeds", play, tasks_in(tmp_path / "tasks")[:1])
    assert [*tmp_path.glob("*.results")] == [new]


# --- the command line ---


def test_the_options_exclude_each_other_and_default_to_every_processor() -> None:
    parser = argparse.ArgumentParser()
    runner.add_arguments(parser)
    assert runner.of(parser.parse_args([]))._jobs == len(os.sched_getaffinity(0))
    with pytest.raises(UsageError, match="omit it or --cluster"):
        runner.of(parser.parse_args(["--jobs", "2", "--cluster", "tcp://a:1"]))


def test_a_command_that_starts_has_loaded_no_pool_and_no_cluster() -> None:
    program = "import sys; from hapticd.__main__ import parser; parser('plate'); parser('bench'); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert "hapticd.tools.campaign.runner" in loaded
    assert not {"concurrent.futures", "multiprocessing", "distributed", "_hashlib"} & {*loaded}

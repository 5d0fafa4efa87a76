"""Campaigns: the same results whoever plays the tasks, and whoever is killed meanwhile."""

from __future__ import annotations

import os
import socket
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import campaign_tasks
import msgspec
import numpy as np
import pytest
from campaign_tasks import Outcome, Task, play, times_played

from hapticd.errors import HapticdError, UsageError
from hapticd.tools import campaigns

SEEDS = range(12)


def tasks_in(folder: Path, **of_seed_4: Any) -> list[Task]:
    folder.mkdir(exist_ok=True)
    return [Task(seed, str(folder), **of_seed_4 if seed == 4 else {}) for seed in SEEDS]


def run(tasks: list[Task], **how: Any) -> list[Outcome]:
    return campaigns.run("seeds", play, tasks, **how)


def bits(outcomes: list[Outcome]) -> list[bytes]:
    """What the tables are made of."""
    return [campaigns.encode(outcome[:3]) for outcome in outcomes]


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    return bits(run(tasks_in(tmp_path_factory.mktemp("alone"))))


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """A scheduler and two workers on loopback."""
    distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50, host="127.0.0.1"
    ) as started:
        yield started.scheduler_address


@pytest.fixture(params=["processes", pytest.param("cluster", marks=pytest.mark.long)])
def workers(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Two of this computer, or of a cluster."""
    return {"jobs": 2} if request.param == "processes" else {"cluster": request.getfixturevalue("cluster")}


def test_results_keep_type_order_and_last_bit(tmp_path: Path) -> None:
    (outcome,) = run([Task(2, str(tmp_path))])
    drawn = np.random.default_rng(2).standard_normal((3, 4))
    assert type(outcome) is Outcome
    assert outcome.total == float(np.exp(drawn).sum())
    assert outcome.worst == float("inf")
    assert np.array_equal(outcome.drawn, drawn.T)


def test_workers_give_the_results_of_one_process(
    workers: dict[str, Any], tmp_path: Path, expected: list[bytes]
) -> None:
    outcomes = run(tasks_in(tmp_path), **workers)
    assert bits(outcomes) == expected
    assert os.getpid() not in {outcome.process for outcome in outcomes}
    assert {outcome.blas_threads for outcome in outcomes} == {"1"}


def test_a_task_whose_worker_is_killed_is_repeated(
    workers: dict[str, Any], tmp_path: Path, expected: list[bytes]
) -> None:
    assert bits(run(tasks_in(tmp_path, deaths=1), **workers)) == expected
    assert times_played(tmp_path, 4) == 2


def test_a_task_that_kills_each_process_ends_the_campaign_with_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(campaigns, "LOSSES", 2)
    with pytest.raises(HapticdError, match=r"lost .* 2 times"):
        run(tasks_in(tmp_path, deaths=99)[4:6], jobs=2)


@pytest.mark.long
def test_no_worker_of_a_cluster_holds_a_result_that_was_fetched(cluster: str, tmp_path: Path) -> None:
    missing = {bytes((task.seed,)): task for task in tasks_in(tmp_path)}
    played = campaigns._played(play, missing, 1, cluster)
    fetched = [next(played) for _ in SEEDS[1:]]
    with pytest.importorskip("distributed").Client(cluster, set_as_default=False) as client:
        # A scheduler repeats what a client holds; that it does not any more shows within some of these round trips.
        held = min(sum(map(len, client.has_what().values())) for _ in range(100))
    assert held <= 1
    assert len({*fetched, *played}) == len(SEEDS)


@pytest.mark.long
def test_a_cluster_without_scheduler_or_workers_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra `cluster`")
    monkeypatch.setattr(campaigns, "CONNECT_S", 0.2)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", host="127.0.0.1") as empty,
        closing(socket.create_server(("127.0.0.1", 0))) as mute,
    ):
        other_server = f"tcp://127.0.0.1:{mute.getsockname()[1]}"
        addresses = ("tcp://127.0.0.1:9", "127.0.0.1:nine", "nonsense://x", empty.scheduler_address, other_server)
        for address in addresses:
            with pytest.raises(UsageError, match=rf"--cluster: .*{address}.*`dask scheduler`"):
                run(tasks_in(tmp_path), cluster=address)


def test_without_dask_the_sentence_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(HapticdError, match=r"--cluster .* install .*distributed"):
        run(tasks_in(tmp_path), cluster="tcp://127.0.0.1:9")


def test_a_worker_with_other_sources_plays_nothing(tmp_path: Path) -> None:
    task = Task(1, str(tmp_path))
    assert campaigns._play(play, task, campaigns.code_of(play))
    with pytest.raises(HapticdError, match="has other sources of hapticd"):
        campaigns._play(play, task, "others")
    assert times_played(tmp_path, 1) == 1


# --- results that are kept ---

CAMPAIGN = """
import sys
from pathlib import Path
from campaign_tasks import Task, play
from hapticd.tools import campaigns
folder, keep = sys.argv[1:]
campaigns.run(
    "seeds", play, [Task(seed, folder, ends_after=keep * (seed == 4)) for seed in range(12)], jobs=2, keep=Path(keep)
)
"""


def test_a_campaign_that_was_killed_plays_only_what_is_missing(tmp_path: Path, expected: list[bytes]) -> None:
    folder, keep = tmp_path / "tasks", tmp_path / "kept.results"
    tasks = tasks_in(folder, ends_after=str(keep))
    path = os.pathsep.join([str(Path(campaign_tasks.__file__).parent), *sys.path])
    # Its output ends when the last of its processes has ended.
    done = subprocess.run(
        [sys.executable, "-c", CAMPAIGN, str(folder), str(keep)],
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode < 0
    kept = {key for (key,) in sqlite3.connect(keep).execute("SELECT key FROM results")}
    before = {task.seed for task in tasks if campaigns.key_of(play, task) in kept}
    assert before <= {*SEEDS} - {4}
    assert len(before) >= 3
    assert bits(run(tasks, jobs=2, keep=keep)) == expected
    assert all(times_played(folder, seed) == 1 for seed in before)
    assert times_played(folder, 4) == 2


def test_kept_results_serve_later_calls_after_an_error_and_with_more_tasks(
    tmp_path: Path, expected: list[bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, keep = tmp_path / "tasks", tmp_path / "kept.results"
    with pytest.raises(ValueError, match="seed 4"):
        run(tasks_in(folder, fails=True), keep=keep)
    for count in (5, 12, 12):
        assert bits(run(tasks_in(folder)[:count], keep=keep)) == expected[:count]
    assert [times_played(folder, seed) for seed in SEEDS] == [1] * 4 + [2] + [1] * 7
    assert "4 of 5" in capsys.readouterr().err


def test_without_keep_a_campaign_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "home"
    home.mkdir()
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(home))
    monkeypatch.chdir(home)
    with pytest.raises(ValueError, match="seed 4"):
        run(tasks_in(tmp_path / "tasks", fails=True), jobs=2)
    assert [*home.rglob("*")] == []


def test_equal_tasks_have_one_key_and_other_code_has_another(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = str(tmp_path)
    key = campaigns.key_of(play, (Task(1, folder), folder))
    assert campaigns.key_of(play, (Task(1, folder), str(tmp_path))) == key  # not the same object twice
    assert campaigns.key_of(play, (Task(2, folder), folder)) != key
    assert campaigns.key_of(tasks_in, (Task(1, folder), folder)) != key
    monkeypatch.setattr(campaigns, "code_of", lambda _: "edited")
    assert campaigns.key_of(play, (Task(1, folder), folder)) != key


@pytest.mark.parametrize("is_pipe", [False, True])
def test_a_file_of_something_else_is_refused_and_left_as_it_is(tmp_path: Path, is_pipe: bool) -> None:
    file = tmp_path / "letter.txt"
    os.mkfifo(file) if is_pipe else file.write_text("Dear Sir")
    for path in (file, tmp_path):
        with pytest.raises(UsageError, match=rf"{path}: .*name another file"):
            run(tasks_in(tmp_path / "tasks"), keep=path)
    assert is_pipe or file.read_text() == "Dear Sir"
    assert not [*(tmp_path / "tasks").iterdir()]


OUTCOME = [1.0, [[4, 3], bytes(96)], None, 1, "1"]


@pytest.mark.parametrize(
    "result",
    [
        b"",
        b"\xc1",
        b"\x91" * 100_000,
        {"a": 1},
        "text",
        *([*OUTCOME[:1], array, *OUTCOME[2:]] for array in ([[9], b""], [[1], b"123"], ["{", [1], bytes(8)])),
        [*OUTCOME[:1], [[1 << 62], bytes(8)], *OUTCOME[2:]],
    ],
)
def test_a_damaged_result_in_a_file_is_one_sentence(result: object, tmp_path: Path) -> None:
    keep = tmp_path / "kept.results"
    task = Task(2, str(tmp_path))
    run([task], keep=keep)
    data = result if isinstance(result, bytes | str) else msgspec.msgpack.encode(result)
    with sqlite3.connect(keep) as database:
        database.execute("UPDATE results SET result = ?", (data,))
    with pytest.raises(HapticdError, match="delete the file of results"):
        run([task], keep=keep)


# --- the command line ---


def test_a_command_that_starts_has_loaded_no_pool_and_no_cluster() -> None:
    program = "import sys; from hapticd.__main__ import parser; parser('plate'); parser('bench'); print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.split()
    assert "hapticd.tools.campaigns" in loaded
    assert not {"concurrent.futures", "multiprocessing", "distributed", "sqlite3", "_hashlib"} & {*loaded}

"""From a configuration to a running daemon: what is prepared, what is refused before anything opens, and SIGHUP."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from asynchronous import PATIENCE_S, asynchronous, until
from machine_bench import PLATE

from hapticd.__main__ import main
from hapticd.config.sections import Config
from hapticd.daemon.settings import pipeline_settings
from hapticd.errors import ConfigError, DeviceError
from hapticd.io.host.systemd import Notifier
from hapticd.sim.plate.ground_truth import GroundTruth, PlateSettings
from hapticd.sim.rig.files import write_measured
from hapticd.sim.rig.process import MODES_FILE
from hapticd.tools import service
from hapticd.tools.service import ConfigLoader, load_modes
from hapticd_client import Client


@pytest.fixture
def configuration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Config:
    """One whose rig runs already, as far as anybody can see: a map, and neither board nor pad yet."""
    PLATE.save(tmp_path / MODES_FILE)
    monkeypatch.setenv("HAPTICD_RUNTIME_DIR", str(tmp_path / "run"))
    return replace(Config(), sim=replace(Config().sim, rig_dir=str(tmp_path)))


@pytest.fixture
def config_loader() -> Iterator[ConfigLoader]:
    with ConfigLoader() as loader:
        yield loader


def test_the_simulated_plate_s_map_is_the_rig_s(
    config_loader: ConfigLoader, configuration: Config, tmp_path: Path
) -> None:
    prepared = config_loader.prepare(configuration)
    assert np.array_equal(prepared.modes.shapes, PLATE.shapes)
    assert prepared.board_port == str(tmp_path / "board")
    assert prepared.runtime_dir == tmp_path / "run"


def test_a_rig_that_wrote_no_map_has_the_one_of_its_seed(configuration: Config, tmp_path: Path) -> None:
    (tmp_path / MODES_FILE).unlink()
    modes = load_modes(configuration, tmp_path)
    assert np.array_equal(modes.shapes, load_modes(Config()).shapes)


def test_what_was_measured_of_the_rig_s_neighbouring_modes_is_taken_to_the_last_bit(
    config_loader: ConfigLoader, configuration: Config, tmp_path: Path
) -> None:
    plate = GroundTruth()
    files = write_measured(plate, 3, tmp_path)
    prepared = config_loader.prepare(configuration)
    known, loaded = plate.parasitic_modes(3), prepared.parasitic_modes
    assert loaded is not None
    assert np.array_equal(loaded.modes.shapes, known.modes.shapes)
    assert loaded.decay_1_s == known.decay_1_s
    assert loaded.detuning_rad_s == pytest.approx(known.detuning_rad_s, rel=1e-15)
    assert {path.name for path in files} == {path.name for path in tmp_path.iterdir()}

    real = replace(configuration, device=replace(configuration.device, port="/dev/ttyACM0"))
    assert service._on_rig(real, tmp_path).plate == real.plate  # another plate


def test_a_simulated_plate_brings_its_size_and_limits_with_its_map(
    config_loader: ConfigLoader, configuration: Config, tmp_path: Path
) -> None:
    plate = GroundTruth(PlateSettings.of("fingertip"))
    write_measured(plate, 1, tmp_path)
    lower = replace(configuration, limits=replace(configuration.limits, w_limit_um=(1.0, 1.0, 1.0, 1.0)))
    prepared, limited = config_loader.prepare(configuration), config_loader.prepare(lower)
    assert prepared.modes.M == 4
    assert prepared.config.plate.size_mm == (190.0, 190.0)
    assert prepared.config.limits.w_limit_um == pytest.approx(plate.w_limit_um)
    assert pipeline_settings(prepared.config).contact_radius_mm == 5.0  # whole fingertips
    assert limited.config.limits.w_limit_um == (1.0, 1.0, 1.0, 1.0)  # a person's own stay


def test_a_rig_is_started_with_the_configured_plate(
    config_loader: ConfigLoader, configuration: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[str, int, str]] = []

    class NoRig:
        def __init__(self, scenario: str, seed: int, *, fingers: str, plate: str, modes: int, wiring: str) -> None:
            del scenario, seed, fingers
            started.append((plate, modes, wiring))
            self.directory = tmp_path

        def close(self) -> None:
            pass

    monkeypatch.setattr(service, "RigProcess", NoRig)
    own = replace(configuration.sim, rig_dir="", plate="fingertip")
    for sim in (own, own, replace(own, modes=3)):
        config_loader.prepare(replace(configuration, sim=sim))
    with pytest.raises(ConfigError, match=r"sim.modes: 7 modes cannot be driven .*: give 2 to 4"):
        config_loader.prepare(replace(configuration, sim=replace(own, modes=7)))
    with pytest.raises(ConfigError, match=r"sim.wiring: the paper's wiring has two amplifiers .* drives 4: choose"):
        config_loader.prepare(replace(configuration, sim=replace(own, wiring="paper")))
    assert started == [("fingertip", 4, "identity"), ("fingertip", 3, "identity")]


def test_what_cannot_run_is_refused_and_nothing_is_opened(
    config_loader: ConfigLoader, configuration: Config, tmp_path: Path
) -> None:
    (tmp_path / "bad.npz").write_bytes(b"junk")
    bad_map = replace(configuration, plate=replace(configuration.plate, modes_file=str(tmp_path / "bad.npz")))
    bad_limits = replace(configuration, limits=replace(configuration.limits, w_limit_um=(4.0,)))
    with pytest.raises(ConfigError):
        config_loader.prepare(bad_map)
    with pytest.raises(ConfigError):
        config_loader.prepare(bad_limits)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "text", "level", "named"),
    [
        ((), "", "WARNING", ("SIMULATED", "device.port and trackpad.source", "--config", "--sim")),
        ((), '[trackpad]\nsource = "evdev"\nsize_mm = [9.0, 9.0]\n', "WARNING", ("SIMULATED: device.port is",)),
        (("--sim",), "", "INFO", ("starting",)),
    ],
)
def test_the_first_line_says_what_is_simulated(
    arguments: tuple[str, ...],
    text: str,
    level: str,
    named: tuple[str, ...],
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(service, "run", lambda *_, **__: None)
    config = tmp_path / "hapticd.toml"
    config.write_text(text, encoding="utf-8")
    with caplog.at_level("INFO"):
        assert main(["run", "--config", str(config), *arguments]) == 0
    assert caplog.records[0].levelname == level
    assert all(word in caplog.text for word in named)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[sim]\nplate = "fingertip"\n', ""),
        ('[sim]\nplate = "fingertip"\n[limits]\nw_limit_um = [1.0, 1.0]\n', "2 limits for a plate of 4 modes"),
        ('[sim]\nplate = "fingertip"\nmodes = 7\n', "sim.modes: 7 modes cannot be driven"),
        ('[sim]\nscenario = "none.csv"\n', "none.csv"),
        ('[device]\ncalibration_file = "none.toml"\n', "none.toml"),
    ],
)
def test_a_simulated_plate_is_checked_without_building_it(
    text: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(service, "RigProcess")
    monkeypatch.setitem(sys.modules, "hapticd.sim.plate.ground_truth", None)
    config = tmp_path / "hapticd.toml"
    config.write_text(text, encoding="utf-8")
    assert main(["run", "--check", "--config", str(config)]) == (78 if sentence else 0)
    assert sentence in capsys.readouterr().err


@asynchronous
async def test_sighup_moves_clients_to_the_new_configuration_and_a_bad_one_keeps_the_old(
    config_loader: ConfigLoader,
    configuration: Config,
    manager: socket.socket,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level("INFO", "hapticd")
    runtime_dir = tmp_path / "run"
    read = [configuration]
    bad = tmp_path / "bad"
    bad.touch()
    judge = (
        sys.executable,
        "-c",
        f"import os, sys; sys.exit('hapticd: It is bad.' if os.path.exists({str(bad)!r}) else 0)",
    )
    notifier = Notifier({"NOTIFY_SOCKET": manager.getsockname()})
    prepared = config_loader.prepare(configuration)
    serving = asyncio.create_task(service._serve(config_loader, prepared, notifier, lambda: read.pop(0), judge))
    await until(lambda: (runtime_dir / "control").is_socket())
    with await asyncio.to_thread(Client, runtime_dir, timeout_s=PATIENCE_S) as client:
        first = await asyncio.to_thread(client.status)
        os.kill(os.getpid(), signal.SIGHUP)
        await until(lambda: "SIGHUP: It is bad. The present configuration stays." in caplog.text)
        assert not serving.done()
        bad.unlink()
        os.kill(os.getpid(), signal.SIGHUP)
        await until(lambda: caplog.text.count("serving clients in") == 2)
    with await asyncio.to_thread(Client, runtime_dir, timeout_s=PATIENCE_S) as client:
        second = await asyncio.to_thread(client.status)
        while "tick_late" not in second["timing"]["histograms"]:  # of the second daemon: it counts from 0
            second = await asyncio.to_thread(client.status)
    assert first["real_time"]["refused"] == second["real_time"]["refused"] == []
    os.kill(os.getpid(), signal.SIGTERM)
    await asyncio.wait_for(serving, PATIENCE_S)
    notifier.close()
    ready = f"READY=1\nSTATUS=serving clients in {runtime_dir}".encode()
    received = []
    with contextlib.suppress(BlockingIOError):
        while True:
            received.append(manager.recv(200))
    assert [message for message in received if message != b"WATCHDOG=1"] == [ready, ready, b"STOPPING=1"]
    assert read == []
    assert sorted(os.listdir(runtime_dir)) == ["lock"]


def test_what_goes_bad_after_it_was_judged_leaves_the_configuration_in_force(
    config_loader: ConfigLoader, configuration: Config, caplog: pytest.LogCaptureFixture
) -> None:
    bad = replace(configuration, limits=replace(configuration.limits, w_limit_um=(4.0,)))
    prepared = asyncio.run(service._prepared(config_loader, bad, configuration, Notifier({})))
    assert prepared.config == configuration
    assert (
        "has 1 limits for a plate of 2 modes: give one for each mode. The present configuration stays." in caplog.text
    )


@asynchronous
async def test_a_rig_that_is_killed_ends_the_service_with_a_sentence(
    config_loader: ConfigLoader, configuration: Config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class IdleRig(service.RigProcess):
        """A process in the rig's place, with a directory that has a map and no devices."""

        def __init__(self, scenario: str, seed: int, *, fingers: str, plate: str, modes: int, wiring: str) -> None:
            del scenario, seed, fingers, plate, modes, wiring
            self._directory = tempfile.TemporaryDirectory(prefix="hapticd-rig-")
            self.directory = Path(self._directory.name)
            PLATE.save(self.directory / MODES_FILE)
            self.process = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    monkeypatch.setattr(service, "RigProcess", IdleRig)
    config = replace(configuration, sim=replace(configuration.sim, rig_dir=""))
    prepared = config_loader.prepare(config)
    serving = asyncio.create_task(service._serve(config_loader, prepared, Notifier({}), None))
    await until((tmp_path / "run" / "control").exists)
    (rig,) = config_loader._rigs.values()
    rig.process.kill()
    with pytest.raises(DeviceError, match="The simulated rig has ended: start this command again"):
        await asyncio.wait_for(serving, PATIENCE_S)
    assert not (tmp_path / "run" / "control").exists()


def test_a_configuration_is_checked_without_opening_anything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    PLATE.save(tmp_path / "map.npz")
    config = tmp_path / "hapticd.toml"
    text = f'[plate]\nmodes_file = "map.npz"\n[sim]\nrig_dir = "{tmp_path}"\n'
    for limits, code, said in (("[4.0, 4.0]", 0, ""), ("[4.0]", 78, "give one for each mode.")):
        config.write_text(f"{text}[limits]\nw_limit_um = {limits}\n", encoding="utf-8")
        assert main(["run", "--check", "--config", str(config)]) == code
        assert said in capsys.readouterr().err
    assert not (tmp_path / "run").exists()

"""Validation of configurations: each error is one sentence with the key and the remedy."""

from __future__ import annotations

import contextlib
import math
import tomllib
from dataclasses import fields, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hapticd.config import loader as config
from hapticd.config import person
from hapticd.config.sections import (
    PAD_NAMES,
    PLATE_NAMES,
    SCENARIO_NAMES,
    SIMULATED,
    WIRING_NAMES,
    Config,
    DeviceConfig,
    PlateConfig,
    UncertaintyConfig,
)
from hapticd.core.friction import DEFAULT_FRICTION_CURVE
from hapticd.daemon.settings import friction_curve
from hapticd.errors import ConfigError
from hapticd.sim.fingers.scenarios import SCENARIOS
from hapticd.sim.plate.glasses import GLASSES
from hapticd.sim.plate.wirings import WIRINGS
from hapticd.wire.trackpad import PADS


def load(text: str, tmp_path: Path) -> Config:
    path = tmp_path / "hapticd.toml"
    path.write_text(text, encoding="utf-8")
    return config.load(path)


def test_an_empty_file_is_the_default_and_the_default_is_the_simulated_plate(tmp_path: Path) -> None:
    loaded = load("", tmp_path)
    assert loaded == Config()
    assert loaded.trackpad.source == loaded.device.port == SIMULATED
    assert config.simulated(Config(device=DeviceConfig(port="/dev/ttyACM0"))) == Config()
    assert (loaded.rig_dir, loaded.device.plate_delay_ms) == ("", 0.0)
    tracked = load('[trackpad]\nsource = "tuio"\ndevice = "127.0.0.1:3334"\nsize_mm = [200.0, 150.0]\n', tmp_path)
    assert (tracked.trackpad.size_mm, tracked.rig_dir) == ((200.0, 150.0), "")


def test_what_is_printed_is_what_is_in_force(tmp_path: Path) -> None:
    changed = load('[limits]\nw_limit_um = [3.5, 2]\n[log]\nlevel = "debug"\n[sim]\nseed = 7\n', tmp_path)
    assert load(config.render(changed), tmp_path) == changed
    assert changed.limits.w_limit_um == (3.5, 2.0)


def test_references_leave_room_for_what_is_not_known_of_the_sensors(tmp_path: Path) -> None:
    known = load("[limits]\nw_limit_um = [3, 4]\n[uncertainty]\nsensors_frac = 0.003", tmp_path)
    assert known.reference_limit_um == pytest.approx((3.0 * 0.95, 4.0 * 0.95))
    usual = load("[limits]\nw_limit_um = [3, 4]\n[uncertainty]\nsensors_frac = 0.02", tmp_path)
    unseen_um = 3.0 * 0.02 * 5.0  # of both modes at their limits
    assert usual.reference_limit_um == pytest.approx((3.0 * 0.99 - unseen_um, 4.0 * 0.99 - unseen_um))
    shared = "[limits]\nw_limit_um = [3, 4]\n[uncertainty]\nsensors_frac = 0.02\ngain_frac = 0.03"
    unseen_um = [3.0 * math.hypot(0.02 * 5.0, 0.03 * limit_um) for limit_um in (3.0, 4.0)]  # a gain counts in its mode
    left_um = (3.0 * 0.99 - unseen_um[0], 4.0 * 0.99 - unseen_um[1])
    assert load(shared, tmp_path).reference_limit_um == pytest.approx(left_um)
    unknown = load("[limits]\nw_limit_um = [3, 4]\n[uncertainty]\nsensors_frac = 1", tmp_path)
    assert unknown.reference_limit_um == pytest.approx((0.75, 1.0))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[limits]\nw_limit = 3", "limits.w_limit: unknown key, did you mean w_limit_um?"),
        ("[limits]\nstrength = 3", "limits.strength: unknown key, valid are w_limit_um."),
        ("[limts]\n", "unknown section [limts], did you mean limits?"),
        ("[qqq]\n", "unknown section [qqq]"),
        ("[device]\nbaud = 'fast'", "device.baud: must be a whole number, not 'fast'"),
        ("[device]\nbaud = 1.5", "device.baud: must be a whole number"),
        ("[device]\nbaud = true", "device.baud: must be a whole number"),
        ("[device]\nport = 3", "device.port: must be a text in quotes"),
        ("[trackpad]\nlatency_ms = 400", "trackpad.latency_ms: 400 is out of bounds, it must be 0 .. 50"),
        ("[trackpad]\nlatency_ms = nan", "trackpad.latency_ms: nan is out of bounds"),
        ("[limits]\nw_limit_um = [4, 400]", "limits.w_limit_um: 400 is out of bounds, it must be 0.01 .. 20"),
        ("[limits]\nw_limit_um = 4", "limits.w_limit_um: must be a list of numbers, such as [4.0, 4.0]"),
        ("[limits]\nw_limit_um = []", "limits.w_limit_um: needs one number per mode"),
        ("[prediction]\npad_weights = [1, 2]", "prediction.pad_weights: needs 10 numbers, not 2"),
        ("[trackpad]\nsource = 'mouse'", "'mouse' is not one of sim, hid, evdev, tuio, replay"),
        ("[trackpad]\nsource = 'tuio'", "trackpad.size_mm: TUIO gives shares of the surface"),
        ("[trackpad]\nsource = 'tuio'\ndevice = '3333'", "trackpad.device: must be an address and a port"),
        (
            "[trackpad]\nsource = 'tuio'\ntuio_sender = 'wall:3333'",
            "trackpad.tuio_sender: must be the tracker's address",
        ),
        ("[trackpad]\nsize_mm = [10.0]", "trackpad.size_mm: needs 2 numbers, not 1"),
        ("[trackpad]\nsource = 'replay'", "trackpad.device: source"),
        ("[trackpad]\noffset_mm = [1]", "trackpad.offset_mm: needs 2 numbers, not 1"),
        ("[plate]\nmodes_file = 'gone.npz'", "plate.modes_file: there is no file"),
        ("[device]\ncalibration_file = 'gone.toml'", "device.calibration_file: there is no file"),
        ("[plate]\nfriction_curve = [0, 2, 1]", "plate.friction_curve: needs two or more rising numbers"),
        ("[device]\nport = '/dev/ttyACM0'", 'real board: set it to "hid", "evdev" or "tuio"'),
        ("[sim]\nseed = -1", "sim.seed: -1 is out of bounds, it must be 0 .. 2147483647."),
        ("[device]\nport = 'x'\n[trackpad]\nsource = 'hid'", "plate.modes_file: a real plate needs"),
        ("[realtime]\nfifo_priority = true", "realtime.fifo_priority: must be a whole number, not True"),
        ("[client]\ntcp = '10.0.0.1:7410'", "client.tcp: needs keys"),
        ("[client]\ntcp = '10.0.0.1'\nkeys_dir = 'k'", "client.tcp: must be an address and the first of three ports"),
        ("[client]\ntcp = ':7410'\nkeys_dir = 'k'", "client.tcp: must be an address"),
        ("[client]\ntcp = '*:65534'\nkeys_dir = 'k'", "client.tcp: must be an address"),
        ("[client]\ntcp = '*:0'\nkeys_dir = 'k'", "client.tcp: must be an address"),
        ("[client]\ntcp = '*:\u0661'\nkeys_dir = 'k'", "client.tcp: must be an address"),
        ("[device]\ncontroller = 'hope'", "device.controller: 'hope' is not one of pi, pi_ff, deadbeat"),
        ("[trackpad]\nsource = 'hid'\ndevice = 'mt3'", "trackpad.device: 'mt3' is not one of usbc-usb"),
        ("[record]\nmax_mb = true", "record.max_mb: must be a whole number"),
        ("[sim]\nscenario = 'dance'", "sim.scenario: 'dance' is not one of strokes"),
        ("[sim]\nseed = 9223372036854775808\n", "beyond 64 bits"),
        ("[limits]\nw_limit_um = [1" + "0" * 400 + "]\n", "beyond 64 bits"),
        ("[sim]\nseed = " + "9" * 5000, "not valid TOML"),
        ("a = " + "[" * 5000, "nests too deeply"),
        ("a" + ".a" * 16 + " = 1", "16 dots or more"),
        ('[plate]\nmodes_file = "a\\u0000b"\n', "not one printable line"),
        ("#" * 65537, "More than 65536 bytes"),
        ("[plate]\nmodes_file = '" + "x" * 300 + "'\n", "there is no file"),
        ('[solver]\ncontact_radius_mm = "much"\n', "must be a number"),
        ("limits = 3", "limits is a section"),
        ("[limits", "is not valid TOML"),
    ],
)
def test_a_wrong_file_is_refused_in_one_sentence(text: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError) as caught:
        load(text, tmp_path)
    message = str(caught.value)
    assert sentence in message
    assert "hapticd.toml" in message
    assert message.endswith("?" if "did you mean" in message else ".")
    assert "?." not in message
    assert message.isprintable()


def test_the_names_that_it_accepts_are_those_that_exist() -> None:
    assert set(SCENARIO_NAMES) == set(SCENARIOS)
    assert tuple(GLASSES) == PLATE_NAMES
    assert WIRINGS == WIRING_NAMES
    assert tuple(PADS) == PAD_NAMES


def test_file_names_are_taken_from_the_configurations_own_folder(tmp_path: Path) -> None:
    for name in ("modes.npz", "pad.yml", "fingers.csv"):
        (tmp_path / name).write_bytes(b"x")
    loaded = load(
        "[plate]\nmodes_file = 'modes.npz'\n"
        "[trackpad]\nsource = 'replay'\ndevice = 'pad.yml'\n[sim]\nscenario = 'fingers.csv'\n"
        "[client]\ntcp = '[::1]:7410'\nkeys_dir = 'keys'\n"
        "[record]\nfile = 'all.mcap'\n",
        tmp_path,
    )
    found = loaded.plate.modes_file, loaded.trackpad.device, loaded.sim.scenario
    found += loaded.client.keys_dir, loaded.record.file
    names = ("modes.npz", "pad.yml", "fingers.csv", "keys", "all.mcap")
    assert found == tuple(str(tmp_path.resolve() / name) for name in names)


@given(st.text(max_size=200))
def test_no_text_raises_anything_but_a_config_error(text: str) -> None:
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    with contextlib.suppress(ConfigError):
        config.from_table(table, where="x", folder=Path("/nonexistent"))


def test_at_most_forty_keys_are_left() -> None:
    assert sum(len(fields(getattr(Config(), section.name))) for section in fields(Config)) <= 40


@pytest.mark.parametrize(
    ("matrix", "sentence"), [("[1.0, 0.0]", "needs 4 numbers"), ("[1, 1, 1, 1]", "nearly singular")]
)
def test_a_matrix_that_is_none_is_refused(matrix: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=sentence):
        load(f"[trackpad]\nmatrix = {matrix}\n", tmp_path)


def test_a_simulated_plate_sets_size_and_limits_but_none_that_a_person_set() -> None:
    reach_um = (4.2, 3.6, 1.4, 1.5)
    on_plate = config.on_plate(Config(), (200.0, 200.0), reach_um)
    assert (on_plate.plate.size_mm, on_plate.limits.w_limit_um) == ((200.0, 200.0), reach_um)
    own = replace(Config(), limits=replace(Config().limits, w_limit_um=(1.0,) * 4))
    assert config.on_plate(own, (200.0, 200.0), reach_um).limits.w_limit_um == (1.0,) * 4


def test_a_simulated_plate_sets_its_uncertainty_but_not_over_a_person_s() -> None:
    ideal = UncertaintyConfig(map_frac=0.0)
    assert config.with_uncertainty(Config(), ideal).uncertainty == ideal
    own = replace(Config(), uncertainty=UncertaintyConfig(map_frac=0.1))
    assert config.with_uncertainty(own, ideal) == own


def test_a_measured_friction_curve_has_floor_and_speed_the_built_in_one_a_speed() -> None:
    text = "[plate]\nfriction_curve = [0, 1, 3]\nfriction_floor_frac = 0.25\nfriction_speed_mm_s = 200\n"
    curve = friction_curve(config.from_table(tomllib.loads(text), where="x", folder=None))
    assert (curve.knots[0], curve.floor_frac, curve.speed_mm_s) == ((0.0, 3.0), 0.25, 200.0)
    assert friction_curve(Config()).knots == DEFAULT_FRICTION_CURVE.knots
    fast = friction_curve(config.from_table({"plate": {"friction_speed_mm_s": 200.0}}, where="x", folder=None))
    assert (fast.knots, fast.speed_mm_s) == (DEFAULT_FRICTION_CURVE.knots, 200.0)


def test_the_friction_of_another_file_takes_the_place_of_the_plates(tmp_path: Path) -> None:
    configured = Config(plate=PlateConfig(friction_speed_mm_s=300.0, friction_curve=(0.0, 2.0)))
    own = tmp_path / "P03.toml"

    def taken() -> PlateConfig:
        return person.load(own, configured.plate)[0]

    own.write_text("[plate]\nfriction_curve = [0.0, 0.4, 1.5]\nfriction_floor_frac = 0.1\n", encoding="utf-8")
    plate = taken()
    assert (plate.friction_curve, plate.friction_floor_frac, plate.friction_speed_mm_s) == ((0.0, 0.4, 1.5), 0.1, 300.0)
    own.write_text("[plate]\nfriction_curve = [0.0, 1.5]\nfriction_speed_mm_s = 80\n", encoding="utf-8")
    assert taken().friction_speed_mm_s == 80.0
    own.write_text("[plate]\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="holds no friction curve: measure it"):
        taken()


def test_keys_and_sections_of_another_version_are_left_out() -> None:
    table = {"plate": {"size_mm": [137.5, 137.5], "gone": 1}, "lost": {"key": 2}, "log": 3}
    assert config.known_keys(table) == {"plate": {"size_mm": [137.5, 137.5]}}

"""`firmware/core/protocol.h` is the one source of the wire layout: what Python holds must follow from its text."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import pytest

from hapticd.board_values import BoardState, SetWiring, Verdict
from hapticd.wire import device, protocol, reference
from hapticd.wire.device import encode_set_wiring
from hapticd.wire.framing import FrameSplitter

HEADER = Path(__file__).parents[2] / "firmware" / "core" / "protocol.h"
CODES = {"uint8_t": "B", "uint16_t": "H", "uint32_t": "I", "uint64_t": "Q", "float": "f"}


def header_text() -> str:
    """The header without its comments."""
    return re.sub(r"/\*.*?\*/", "", HEADER.read_text(), flags=re.DOTALL)


def hash_of(text: str) -> int:
    lines = [line for line in text.splitlines() if "define HD_PROTOCOL_HASH" not in line]
    return zlib.crc32(re.sub(r"\s+", "", "".join(lines)).encode())


def constant(name: str) -> float:
    match = re.search(rf"#define {name} (\S+)", header_text())
    assert match, name
    return float(match[1].rstrip("f")) if "." in match[1] else int(match[1].rstrip("u"), 0)


def enumeration(name: str) -> dict[str, int]:
    match = re.search(rf"enum {name} \{{(.*?)\}}", header_text(), flags=re.DOTALL)
    assert match, name
    return {key: int(value, 0) for key, value in re.findall(r"(\w+) = (\w+)", match[1])}


def layout(name: str, modes: int = 2) -> str:
    """The struct format of a packed structure, nested structures spelled out."""
    body = re.search(rf"typedef struct HD_PACKED \{{([^}}]*)\}} {name};", header_text())
    assert body, name
    parts: list[str] = []
    for kind, count in re.findall(r"(\w+) \w+(?:\[([\w* ]+)\])?;", body[1]):
        n = {
            "": 1,
            "HD_MODES": modes,
            "HD_MODES * HD_MODES": modes * modes,
            "HD_LOG_ENTRIES": protocol.LOG_ENTRIES,
        }.get(count) or int(count)
        if count == "16" and kind == "uint8_t":
            parts.append("16s")
        else:
            parts.append((CODES.get(kind) or layout(kind, modes)) * n)
    return "".join(parts)


def test_the_hash_in_header_and_host_is_that_of_the_headers_text() -> None:
    computed = hash_of(header_text())
    assert constant("HD_PROTOCOL_HASH") == computed, f"protocol.h changed: its hash is now 0x{computed:08x}"
    assert computed == protocol.PROTOCOL_HASH, f"PROTOCOL_HASH of hapticd.wire.device is now 0x{computed:08x}"
    assert constant("HD_PROTOCOL_VERSION") == protocol.PROTOCOL_VERSION


def test_the_protocols_text_has_the_hash_and_the_commands() -> None:
    text = (HEADER.parents[1] / "PROTOCOL.md").read_text(encoding="utf-8")
    assert f"0x{protocol.PROTOCOL_HASH:08x} today" in text
    assert sum(1 << value for value in enumeration("hd_message").values() if value < 0x20) == device.ALL_COMMANDS


def test_the_hash_sees_a_changed_field_but_not_a_changed_comment() -> None:
    text = header_text()
    assert hash_of(text.replace("uint16_t seq", "uint32_t seq")) != hash_of(text)
    assert hash_of(text.replace("\n", "\n\n  ")) == hash_of(text)


FIXED = (
    *("reference", "keepalive", "time_request", "set_controller", "set_model", "set_drive", "set_baud", "sweep"),
    *("raw_voltage", "set_telemetry", "time", "log_entry", "verdict"),
)


@pytest.mark.parametrize("name", FIXED)
def test_fixed_payloads_are_laid_out_as_the_header_says(name: str) -> None:
    host: struct.Struct = getattr(protocol, name.upper())
    assert host.format == "<" + layout(f"hd_wire_{name}_t")


@pytest.mark.parametrize("modes", [2, 3, 8])
def test_payloads_that_grow_with_the_modes_are_laid_out_as_the_header_says(modes: int) -> None:
    assert layout("hd_wire_hello_t", modes) == protocol.HELLO.format[1:] + "f" * modes + protocol.MORE_HELLO.format[1:]
    status = protocol.STATUS.format[1:] + "ffff" * modes + protocol.MORE_STATUS.format[1:]
    assert layout("hd_wire_status_t", modes) == status
    assert layout("hd_wire_controller_t", modes) == protocol.CONTROLLER.format[1:] + "fffff" * modes
    assert layout("hd_wire_sweep_point_t", modes) == protocol.SWEEP_POINT.format[1:] + "ff" * modes
    assert layout("hd_wire_telemetry_t", modes) == protocol.TELEMETRY.format[1:] + "ffffffff" * modes
    entries = protocol.LOG_ENTRY.format[1:] * protocol.LOG_ENTRIES
    assert layout("hd_wire_log_t", modes) == protocol.LOG.format[1:] + entries
    wires = layout("hd_wire_set_wiring_t", modes)
    assert wires == "f" * modes**2 + "ff" * modes**2 + "ff" * modes**2
    own = tuple(tuple(float(i == j) for j in range(modes)) for i in range(modes))
    assert len(FrameSplitter(4096).feed(encode_set_wiring(SetWiring(own, own, own)))[0]) == 1 + struct.calcsize(
        "<" + wires
    )
    knot = layout("hd_wire_knot_t", modes)
    assert knot == "H" + "ff" * modes
    frame = reference._reference_layout(2, modes)
    assert frame.size == 1 + protocol.REFERENCE.size + 2 * struct.calcsize("<" + knot)


def test_message_ids_states_laws_and_flags_agree() -> None:
    for name, value in enumeration("hd_message").items():
        assert getattr(protocol, name.removeprefix("HD_")) == value
    states = {name.removeprefix("HD_STATE_"): value for name, value in enumeration("hd_state").items()}
    assert states == {state.name: state.value for state in BoardState}
    laws = {name.removeprefix("HD_LAW_").lower(): value for name, value in enumeration("hd_law").items()}
    assert laws == protocol.LAWS
    assert set(enumeration("hd_refusal").values()) == {0, *protocol.REFUSALS}
    assert set(enumeration("hd_fault").values()) == set(protocol.FAULTS)
    assert set(enumeration("hd_event").values()) == set(protocol.EVENTS)
    assert set(enumeration("hd_reset_cause").values()) == set(protocol.RESET_CAUSES)
    verdicts = {name.removeprefix("HD_VERDICT_"): value for name, value in enumeration("hd_verdict").items()}
    assert verdicts == {verdict.name: verdict.value for verdict in Verdict}
    assert enumeration("hd_status_flag") == {
        "HD_STATUS_APPLIED": 1,
        "HD_STATUS_SATURATED": 2,
        "HD_STATUS_LIMITED": 4,
        "HD_STATUS_PULSED": 8,
    }


def test_limits_of_a_frame_agree() -> None:
    assert constant("HD_KNOTS_MAX") == protocol.KNOTS_MAX
    assert constant("HD_KNOT_UNIT_US") * 1000 == protocol.KNOT_UNIT_NS
    assert constant("HD_DEADMAN_US") == 1000 * protocol.DEADMAN_MS
    assert constant("HD_LOG_ENTRIES") == protocol.LOG_ENTRIES


@pytest.mark.parametrize(
    ("low", "high", "bounds"),
    [
        ("HD_BANDWIDTH_MIN_1_S", "HD_BANDWIDTH_MAX_1_S", protocol.BANDWIDTH_1_S),
        ("HD_INTEGRAL_TIME_MIN_S", "HD_INTEGRAL_TIME_MAX_S", protocol.INTEGRAL_TIME_S),
        ("HD_DECAY_MIN_1_S", "HD_DECAY_MAX_1_S", protocol.DECAY_1_S),
        (None, "HD_DETUNING_MAX_RAD_S", protocol.DETUNING_RAD_S),
        ("HD_GAIN_MIN_UM_PER_V_S", "HD_GAIN_MAX_UM_PER_V_S", protocol.GAIN_UM_PER_V_S),
        ("HD_SWEEP_DWELL_MIN_MS", "HD_SWEEP_DWELL_MAX_MS", protocol.SWEEP_DWELL_MS),
        (0.0, "HD_FOLLOW_MAX_HZ", protocol.FOLLOW_HZ),
        (None, "HD_DRIVE_SHARE_MAX", protocol.DRIVE_SHARE),
        (0.0, "HD_SENSE_MAX", protocol.SENSE),
        (0.0, "HD_FEEDTHROUGH_MAX_UM_PER_V", protocol.FEEDTHROUGH_UM_PER_V),
        (None, "HD_SWEEP_OFFSET_MAX_HZ", protocol.SWEEP_OFFSET_HZ),
        (1, "HD_SWEEP_POINTS_MAX", protocol.SWEEP_POINTS),
        (1, "HD_RAW_MAX_MS", protocol.RAW_DURATION_MS),
        (None, "HD_RAW_LIMIT_FRAC", (-protocol.RAW_LIMIT_FRAC, protocol.RAW_LIMIT_FRAC)),
    ],
)
def test_bounds_of_the_commands_agree(low: str | float | None, high: str, bounds: tuple[float, float]) -> None:
    """A bound without a lower end of its own is symmetric."""
    top = constant(high)
    bottom = -top if low is None else constant(low) if isinstance(low, str) else low
    assert (bottom, top) == bounds

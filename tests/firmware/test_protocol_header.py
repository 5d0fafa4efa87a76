"""`firmware/core/protocol.h` is where the protocol is written: what follows from it is as it is made."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from hapticd import board_protocol as protocol
from hapticd.wire import commands

FIRMWARE = Path(__file__).parents[2] / "firmware"


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_protocol", FIRMWARE / "make_protocol.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["make_protocol"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def header(maker: ModuleType, old: str = "", new: str = "") -> object:
    """The parsed header, with one passage changed."""
    text = (FIRMWARE / "core" / "protocol.h").read_text(encoding="utf-8")
    assert old in text
    return maker.Header(text.replace(old, new, 1), (FIRMWARE / "board.h").read_text(encoding="utf-8"))


def test_module_tables_and_hash_are_those_that_the_header_makes(maker: ModuleType) -> None:
    stale = [path.name for path in maker.stale()]
    assert stale == [], "protocol.h has changed: run `make -C firmware protocol`"
    assert header(maker).hash == protocol.PROTOCOL_HASH


def test_the_hash_sees_a_changed_field_but_not_a_changed_comment(maker: ModuleType) -> None:
    assert header(maker, "uint16_t seq", "uint32_t seq").hash != protocol.PROTOCOL_HASH
    assert header(maker, "#ifndef HD_PROTOCOL_H", "/* new */\n  #ifndef HD_PROTOCOL_H").hash == protocol.PROTOCOL_HASH


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("float follow_hz;", "float turns; float follow_hz;", 'SET_DRIVE: Final = struct.Struct("<fff")'),
        ("float follow_hz;", "uint16_t follow_hz;", "    follow_hz: int"),
        ("float follow_hz;", "float follow_d_hz; float follow_q_hz;", "    follow_hz: complex"),
        ("HD_FOLLOW_MAX_HZ 500", "HD_FOLLOW_MAX_HZ 700", '    "follow_hz": (0, 700.0),'),
        ("0 .. HD_FOLLOW_MAX_HZ", "1e-3 .. 7", '    "follow_hz": (1e-3, 7),'),
        ("HD_MSG_SET_DRIVE = 0x0F", "HD_MSG_SET_DRIVE = 0x1F", "MSG_SET_DRIVE: Final = 0x1F"),
        ("/* power-up */", "/* power. Of the supply */", '    1: "power",'),
        ("HD_LOG_ENTRIES 8", "HD_LOG_ENTRIES 9", "LOG_ENTRIES: Final = 9"),
        ("uint32_t image_crc;", "uint16_t image_crc;", 'MORE_HELLO: Final = struct.Struct("<HIBI")'),
    ],
)
def test_what_the_header_says_is_what_the_host_has(maker: ModuleType, old: str, new: str, line: str) -> None:
    assert line not in maker.module(header(maker)).splitlines()
    assert line in maker.module(header(maker, old, new)).splitlines()


def test_an_array_in_a_message_without_a_value_of_its_own_is_refused_with_what_to_do(maker: ModuleType) -> None:
    with pytest.raises(SystemExit, match="baud of SET_BAUD: messages with arrays"):
        maker.module(header(maker, "uint32_t baud;", "uint32_t baud[HD_MODES];"))


def test_every_message_of_the_host_is_a_command_that_a_board_has_to_understand() -> None:
    types = [number for name, number in vars(protocol).items() if name.startswith("MSG_") and number < 0x20]
    assert sum(1 << number for number in types) == commands.ALL_COMMANDS
